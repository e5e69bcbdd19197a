package Replaceable "replaceable, redeclare, constrainedby, component arrays"
  partial model Law
    input Real x;
    output Real f;
    parameter Real k = 1;
  end Law;
  model Linear
    extends Law;
  equation
    f = k*x;
  end Linear;
  model Cubic
    extends Law;
    parameter Real c = 10;
  equation
    f = k*x + c*x^3;
  end Cubic;
  model Body
    replaceable Linear law constrainedby Law;
    Real x(start = 1, fixed = true);
    Real v(start = 0, fixed = true);
  equation
    law.x = x;
    der(x) = v;
    der(v) = -law.f;
  end Body;
  model Two
    Body a;
    Body b(redeclare Cubic law(c = 3, k = 2));
    Linear many[3](k = {1, 2, 3});
    output Real s;
  equation
    for i in 1:3 loop
      many[i].x = a.x;
    end for;
    s = sum(many.f);
  end Two;
  model ByModel
    replaceable model F = Linear constrainedby Law;
    F f;
    Real x = time;
  equation
    f.x = x;
  end ByModel;
  model ByCubic = ByModel(redeclare model F = Cubic);
end Replaceable;
