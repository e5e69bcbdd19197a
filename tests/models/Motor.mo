model Motor "names of the Modelica Standard Library"
  import SI = Modelica.Units.SI;
  import Modelica.Constants.pi;
  parameter SI.Resistance R = 1;
  parameter SI.Inductance L = 0.01;
  parameter Real kt(unit = "N.m/A") = 0.1;
  parameter SI.Inertia J = 1e-3;
  SI.Current i(start = 0, fixed = true);
  SI.AngularVelocity w(start = 0, fixed = true);
  SI.Torque tau;
  SI.Voltage u = 10*Modelica.Math.sin(2*pi*time);
  Modelica.Blocks.Interfaces.RealOutput speed = w;
equation
  L*der(i) = u - R*i - kt*w;
  tau = kt*i;
  J*der(w) = tau;
end Motor;
