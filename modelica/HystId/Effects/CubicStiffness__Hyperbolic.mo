within HystId.Effects;
block CubicStiffness__Hyperbolic "Hardening spring with exponential growth beyond x_c"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m") = 0 "Stiffness scale";
  parameter Real x_c(unit="m", min = 0) = 0.001 "Displacement at which hardening becomes strong";
equation
  f = k*(x_c*sinh(x/x_c) - x);
  annotation(Documentation(info = "<html><p>Membrane-like or rubber-like hardening; reduces to the cubic spring for x much below x_c.</p></html>"));
end CubicStiffness__Hyperbolic;
