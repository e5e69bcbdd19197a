model Nonlinear "implicit spring in series with a linear one, and two coupled equations"
  input Real F;
  output Real d(start = 0.1);
  output Real p(start = 1), q(start = 1);
equation
  F = 100*d + 2e4*d^3 + 5*tanh(10*d);
  p^2 + q^2 = 4 + F^2/100;
  p - q = 0.5*sin(time);
end Nonlinear;
