package FlangeChain "Masses and springs with flanges, and a sampled filter beside them"
  connector Flange
    Real s;
    flow Real f;
  end Flange;

  model Mass
    parameter Real m = 1;
    Flange a, b;
    Real s(start = 0), v(start = 0, fixed = true);
  equation
    a.s = s;
    b.s = s;
    der(s) = v;
    m*der(v) = a.f + b.f;
  end Mass;

  model Spring
    parameter Real c = 100;
    Flange a, b;
  equation
    a.f = c*(a.s - b.s);
    a.f + b.f = 0;
  end Spring;

  model Wall
    Flange a;
  equation
    a.s = 0;
  end Wall;

  model Chain
    Wall w;
    Spring k[3](c = {100, 200, 300});
    Mass m[3](each m = 2, s(start = {0.1, 0, 0}, each fixed = true));
    output Real x = m[3].s;
    discrete output Real y(start = 0, fixed = true);
  equation
    connect(w.a, k[1].a);
    for i in 1:3 loop
      connect(k[i].b, m[i].a);
    end for;
    for i in 1:2 loop
      connect(m[i].b, k[i + 1].a);
    end for;
    when sample(0, 0.1) then
      y = 0.5*pre(y) + sin(time);
    end when;
  end Chain;
end FlangeChain;
