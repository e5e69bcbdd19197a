package Functions "functions with assignments, if, for, arrays, several outputs"
  function poly "Horner"
    input Real c[:];
    input Real x;
    output Real y;
  algorithm
    y := 0;
    for i in size(c, 1):-1:1 loop
      y := y*x + c[i];
    end for;
  end poly;
  function clip
    input Real u;
    input Real low = -1;
    input Real high = 1;
    output Real y;
  algorithm
    if u < low then
      y := low;
    elseif u > high then
      y := high;
    else
      y := u;
    end if;
  end clip;
  function polar
    input Real x;
    input Real y;
    output Real r;
    output Real phi;
  protected
    Real s;
  algorithm
    s := x*x + y*y;
    r := sqrt(s);
    phi := atan2(y, x);
  end polar;
  function factorial "recursion known at compile time"
    input Integer n;
    output Integer y;
  algorithm
    if n <= 1 then
      y := 1;
    else
      y := n*factorial(n - 1);
    end if;
  end factorial;
  function statistics
    input Real u[:];
    output Real mean;
    output Real squares[size(u, 1)];
  algorithm
    mean := sum(u)/size(u, 1);
    for i in 1:size(u, 1) loop
      squares[i] := u[i]^2;
    end for;
  end statistics;
  model Use
    parameter Real c[4] = {1, -2, 0.5, 0.25};
    Real p, q, r, phi, mean, s[3];
    parameter Real n = factorial(5);
  equation
    p = poly(c, time);
    q = clip(3*time - 1, high = 0.5);
    (r, phi) = polar(1 + time, 2*time);
    (mean, s) = statistics({time, 2*time, 3});
  end Use;
end Functions;
