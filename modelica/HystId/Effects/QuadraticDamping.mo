within HystId.Effects;
block QuadraticDamping "Drag proportional to the square of the speed"
  extends HystId.Interfaces.PartialEffect;
  parameter Real c(unit="N.s2/m2", min = 0) = 0 "Drag coefficient";
equation
  f = c*v*abs(v);
  annotation(Documentation(info = "<html><p>Turbulent fluid or orifice damping.</p></html>"),
    __HystId_effect(
      title = "damping that grows with the square of the speed",
      family = "nonlinear damping",
      needs = {"speeds"},
      tells = {Telling(law = "stribeck_friction", experiment = "vary the frequency at a fixed amplitude")},
      experiment = "add a test at higher speed"));
end QuadraticDamping;
