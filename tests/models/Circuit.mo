package Circuit "connectors with flow"
  connector Pin
    Real v(unit = "V");
    flow Real i(unit = "A");
  end Pin;
  partial model OnePort
    Pin p;
    Pin n;
    Real u(unit = "V");
    Real i(unit = "A");
  equation
    u = p.v - n.v;
    0 = p.i + n.i;
    i = p.i;
  end OnePort;
  model Resistor
    extends OnePort;
    parameter Real R(unit = "Ohm") = 1;
  equation
    R*i = u;
  end Resistor;
  model Capacitor
    extends OnePort;
    parameter Real C(unit = "F") = 1;
  equation
    C*der(u) = i;
  end Capacitor;
  model Inductor
    extends OnePort;
    parameter Real L(unit = "H") = 1;
  equation
    L*der(i) = u;
  end Inductor;
  model Source
    extends OnePort;
    parameter Real V(unit = "V") = 1;
  equation
    u = V;
  end Source;
  model Ground
    Pin p;
  equation
    p.v = 0;
  end Ground;
  model RLC "series"
    Source source(V = 5);
    Resistor r(R = 2);
    Inductor l(L = 0.1);
    Capacitor c(C = 1e-2, u(start = 1, fixed = true));
    Ground ground;
    output Real u = c.u;
  equation
    connect(source.p, r.p);
    connect(r.n, l.p);
    connect(l.n, c.p);
    connect(c.n, source.n);
    connect(source.n, ground.p);
  end RLC;
  model Bridge "resistors only: one linear block"
    Source source(V = 10);
    Resistor r1(R = 1), r2(R = 2), r3(R = 3), r4(R = 5), r5(R = 7);
    Ground ground;
    output Real i = r5.i;
  equation
    connect(source.p, r1.p);
    connect(source.p, r3.p);
    connect(r1.n, r2.p);
    connect(r3.n, r4.p);
    connect(r1.n, r5.p);
    connect(r3.n, r5.n);
    connect(r2.n, source.n);
    connect(r4.n, source.n);
    connect(source.n, ground.p);
  end Bridge;
end Circuit;
