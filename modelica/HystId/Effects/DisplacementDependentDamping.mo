within HystId.Effects;
block DisplacementDependentDamping "Viscous damping that grows with the square of the displacement"
  extends HystId.Interfaces.PartialEffect;
  parameter Real c(unit="N.s/m3") = 0 "Damping coefficient";
equation
  f = c*x^2*v;
  annotation(Documentation(info = "<html><p>Van der Pol type damping; loss per cycle grows with the fourth power of the amplitude.</p></html>"),
    __HystId_effect(
      title = "damping that depends on the displacement",
      family = "nonlinear damping",
      needs = {"speeds"},
      experiment = "repeat the test at a fixed frequency and several amplitudes"));
end DisplacementDependentDamping;
