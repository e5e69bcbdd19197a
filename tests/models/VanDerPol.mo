model VanDerPol
  parameter Real mu = 1.5;
  output Real x1(start = 2, fixed = true);
  output Real x2(start = 0, fixed = true);
equation
  der(x1) = x2;
  der(x2) = mu*(1 - x1^2)*x2 - x1;
end VanDerPol;
