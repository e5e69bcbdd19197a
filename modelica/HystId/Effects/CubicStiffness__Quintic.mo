within HystId.Effects;
block CubicStiffness__Quintic "Hardening spring of degrees three and five"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k3(unit="N/m3") = 0 "Cubic stiffness";
  parameter Real k5(unit="N/m5") = 0 "Quintic stiffness";
equation
  f = k3*x^3 + k5*x^5;
  annotation(Documentation(info = "<html><p>For springs that harden faster than with the third power.</p></html>"));
end CubicStiffness__Quintic;
