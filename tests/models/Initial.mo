model Initial "steady start and a parameter found at the start"
  parameter Real a = 2;
  parameter Real k(fixed = false, start = 1);
  parameter Real half = k/2;
  Real x(start = 0.3);
  Real y;
  output Real z;
initial equation
  der(x) = 0;
  y = 3;
equation
  der(x) = k - a*x;
  y = x^2 + 2*k - 7;
  z = half*time + x;
end Initial;
