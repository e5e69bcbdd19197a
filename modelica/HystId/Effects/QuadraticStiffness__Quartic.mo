within HystId.Effects;
block QuadraticStiffness__Quartic "Asymmetric spring of degrees two and four"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k2(unit="N/m2") = 0 "Quadratic stiffness";
  parameter Real k4(unit="N/m4") = 0 "Quartic stiffness";
equation
  f = k2*x^2 + k4*x^4;
  annotation(Documentation(info = "<html><p>For asymmetric springs that grow faster than with the second power.</p></html>"));
end QuadraticStiffness__Quartic;
