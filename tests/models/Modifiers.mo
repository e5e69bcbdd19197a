package Modifiers "every form of modification that has to take effect"
  model A
    parameter Real m = 1;
    parameter Real k = 10;
    Real x(start = 0.5, fixed = true);
    Real y = m*k;
  equation
    der(x) = -x;
  end A;
  model B
    extends A(k = 20);
    parameter Real q = 3;
  end B;
  model C
    extends B(m = 2);
  end C;
  model Short = A(m = 7);
  model Holder
    A a(m = 4);
    parameter Real own = a.m + 1;
  end Holder;
  model Derived
    extends Holder(a(m = 5, k = 6));
  end Derived;
  model Swap
    replaceable A part(m = 11);
  end Swap;
  model Cubic
    extends A;
    parameter Real c = 9;
  end Cubic;
  model All
    A plain;
    A given(m = 2, final k = 3);
    B base;
    B base2(k = 30, m = 3);
    C chain;
    C chain2(k = 40, q = 5);
    Short short;
    Short short2(k = 2);
    Derived derived;
    Holder holder(a(k = 100, x(start = 0.25)));
    A each3[3](each m = 6);
    A list3[3](m = {1, 2, 3}, each k = 2);
    Holder nested[2](a(m = {21, 22}));
    Swap swap;
    Swap swap2(redeclare Cubic part(m = 12, c = 1));
    Swap swap3(part(k = 13));
    A started(x(start = 3, fixed = true));
    parameter Real p = 17;
    A bound(m = p, k = 2*p);
  end All;
  model Extended
    extends All(plain(m = 50), p = 1, swap(part(m = 60)), list3(m = {7, 8, 9}));
  end Extended;
end Modifiers;
