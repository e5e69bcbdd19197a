package Trans "flanges with position and force: states that are tied to each other"
  connector Flange
    Real s(unit = "m");
    flow Real f(unit = "N");
  end Flange;
  model Mass
    parameter Real m(unit = "kg") = 1;
    Flange a;
    Flange b;
    Real s(unit = "m", start = 0.1);
    Real v(unit = "m/s", start = 0);
  equation
    a.s = s;
    b.s = s;
    v = der(s);
    m*der(v) = a.f + b.f;
  end Mass;
  model SpringDamper
    parameter Real c(unit = "N/m") = 100;
    parameter Real d(unit = "N.s/m") = 2;
    Flange a;
    Flange b;
    Real s_rel(unit = "m");
    Real v_rel(unit = "m/s");
    Real f(unit = "N");
  equation
    s_rel = b.s - a.s;
    v_rel = der(s_rel);
    f = c*s_rel + d*v_rel;
    b.f = f;
    a.f = -f;
  end SpringDamper;
  model Fixed
    Flange a;
  equation
    a.s = 0;
  end Fixed;
  model Two "two masses, two springs"
    Mass m1(s(fixed = true), v(fixed = true));
    Mass m2(m = 2, s(start = 0.2, fixed = true), v(fixed = true));
    SpringDamper s1;
    SpringDamper s2(c = 150, d = 1);
    Fixed wall;
  equation
    connect(wall.a, s1.a);
    connect(s1.b, m1.a);
    connect(m1.b, s2.a);
    connect(s2.b, m2.a);
  end Two;
  model Rigid "two masses bolted together"
    Mass m1(s(fixed = true), v(fixed = true));
    Mass m2(m = 3);
    SpringDamper spring;
    Fixed wall;
  equation
    connect(wall.a, spring.a);
    connect(spring.b, m1.a);
    connect(m1.b, m2.a);
  end Rigid;
  model Pendulum "Cartesian coordinates"
    parameter Real L = 1;
    parameter Real g = 9.81;
    Real x(start = 0.6, fixed = true);
    Real y(start = -0.8);
    Real vx(start = 0, fixed = true);
    Real vy;
    Real tension;
  equation
    der(x) = vx;
    der(y) = vy;
    der(vx) = -tension*x;
    der(vy) = -tension*y - g;
    x^2 + y^2 = L^2;
  end Pendulum;
end Trans;
