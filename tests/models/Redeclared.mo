package Redeclared "Modifiers inside redeclarations, constraining clauses and beside attributes"
  constant Real stiff = 7;

  partial model Spring
    input Real x;
    output Real f;
  end Spring;

  model Lin
    extends Spring;
    parameter Real k = 10;
  equation
    f = k*x;
  end Lin;

  model Cub
    extends Spring;
    parameter Real k3(min = 0) = 5;
    parameter Real k1 = 0;
  equation
    f = k3*x^3 + k1*x;
  end Cub;

  model Osc
    replaceable model S = Lin constrainedby Spring;
    S s;
    Real x(start = 1, fixed = true), v(start = 0, fixed = true);
  equation
    s.x = x;
    der(x) = v;
    der(v) = -s.f;
  end Osc;

  model InModifiers
    extends Osc(redeclare model S = Cub(k3 = 7, // a comment, and a list over two lines
      k1 = 2));
  end InModifiers;

  model Bounded
    extends Osc(redeclare model S = Cub(k3(min = 1) = stiff, k1 = 2));
  end Bounded;

  model AsElement
    extends Osc;
    redeclare model S = Cub(k3(min = 1) = 7, k1 = 2);
  end AsElement;

  model Components
    Osc a[2](redeclare each model S = Cub(k3 = 7, k1 = 2)), b(redeclare model S = Lin(k = 3), x(start = 0.5));
  end Components;

  partial model P
    parameter Real n = 1;
  end P;

  model Q
    extends P;
    parameter Real j = 2;
    Real y = n*time*j;
  end Q;

  model R
    extends P;
    Real y = 2*n*time;
  end R;

  model Hold
    replaceable Q f constrainedby P(n = 15) "Every part that stands here has n = 15";
  end Hold;

  model HoldOwn
    replaceable Q f(n = 3, j = 4) constrainedby P(n = 15);
  end HoldOwn;

  model Held
    extends Hold(redeclare R f);
  end Held;

  model HeldInComponent
    Hold h(redeclare R f(n = 4));
  end HeldInComponent;

  model HoldClass
    replaceable model F = Q constrainedby P(n = 15);
    F f;
  end HoldClass;

  model A
    parameter Real m = 1;
    parameter Real p[2] = {1, 1};
    Real y(start = 1, fixed = true);
  equation
    der(y) = m*p[2];
  end A;

  model Extended
    extends A(m(min = 0.1) = 1.5, final p(each min = 0.5) = {2, 3}, y(start = 3));
  end Extended;

  model Short = A(m(min = 0.1) = 1.5);

  model HoldA
    A a;
  end HoldA;

  model Deep
    HoldA h(a(m(min = 0.1) = 1.5, p(each min = 0.5) = {2, 3}));
    Short s;
  end Deep;
end Redeclared;
