model Pendulum
  constant Real g = 9.81;
  parameter Real L = 1;
  output Real phi(start = 2.5, fixed = true);
  output Real energy;
  Real w(start = 0, fixed = true);
equation
  der(phi) = w;
  L*der(w) + g*sin(phi) = 0;
  energy = 0.5*(L*w)^2 - g*L*cos(phi);
end Pendulum;
