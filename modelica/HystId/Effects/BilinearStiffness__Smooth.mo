within HystId.Effects;
block BilinearStiffness__Smooth "Breathing crack that closes gradually"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m") = 0 "Stiffness at positive x minus stiffness at negative x";
  parameter Real w(unit="m", min = 0) = 0.0001 "Displacement over which the crack closes";
equation
  f = 0.5*k*(x + sqrt(x^2 + w^2) - w);
  annotation(Documentation(info = "<html><p>Rough crack faces close over a width w.</p></html>"));
end BilinearStiffness__Smooth;
