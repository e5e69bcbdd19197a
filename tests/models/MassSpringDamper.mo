model MassSpringDamper "linear, with dependent parameters"
  parameter Real m(unit = "kg", min = 0) = 2;
  parameter Real f0(unit = "Hz") = 3;
  parameter Real zeta = 0.1;
  final parameter Real w(unit = "rad/s") = 2*3.141592653589793*f0;
  final parameter Real k(unit = "N/m") = m*w^2;
  final parameter Real c(unit = "N.s/m") = 2*zeta*m*w;
  input Real F(unit = "N");
  output Real x(unit = "m", start = 0.01, fixed = true);
  Real v(unit = "m/s", start = 0, fixed = true);
equation
  v = der(x);
  m*der(v) = F - c*v - k*x;
end MassSpringDamper;
