model Rig "One mass, dry friction and an array"
  parameter Real m(unit = "kg", min = 0) = 2;
  parameter Integer n = 3;
  input Real F(unit = "N");
  Real x(start = 0.1, fixed = true), v(start = 0, fixed = true), y[n];
  output Real R = f(x, v);
  function f
    input Real x, v;
    output Real r = 0;
  algorithm
    for i in 1:3 loop r := r + i*x; end for;
    r := if v > 0 then r + 1 else r - 1;
  end f;
equation
  der(x) = v;
  m*der(v) + R = F;
  for i in 1:n loop y[i] = i*x^2; end for;
end Rig;
