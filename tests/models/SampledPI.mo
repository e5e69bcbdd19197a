model SampledPI "sampled controller of a first-order plant"
  parameter Real Ts = 0.05;
  parameter Real kp = 2;
  parameter Real ki = 4;
  input Real r;
  output Real y(start = 0, fixed = true);
  output Real u(start = 0, fixed = true);
  Real integral(start = 0, fixed = true);
  discrete Real error(start = 0, fixed = true);
equation
  der(y) = u - y;
  when sample(0, Ts) then
    error = r - y;
    integral = pre(integral) + Ts*error;
    u = kp*error + ki*integral;
  end when;
end SampledPI;
