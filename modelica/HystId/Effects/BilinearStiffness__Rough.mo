within HystId.Effects;
block BilinearStiffness__Rough "Breathing crack whose rough faces still press on each other at rest"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m") = 0 "Stiffness at positive x minus stiffness at negative x";
  parameter Real w(unit="m", min = 0) = 0.0001 "Displacement over which the crack closes";
equation
  f = 0.5*k*(x + sqrt(x^2 + w^2));
  annotation(Documentation(info = "<html><p>As the smooth form, but the force k w/2 at x = 0 is not taken up by the
mounting: the crack pushes its faces apart.</p></html>"),
    __HystId_effect(
      becomes = {End(law = "preload", of = w, above = 1, per = "stroke")}));
end BilinearStiffness__Rough;
