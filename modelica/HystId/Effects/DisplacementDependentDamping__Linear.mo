within HystId.Effects;
block DisplacementDependentDamping__Linear "Viscous damping that grows with the distance from the middle"
  extends HystId.Interfaces.PartialEffect;
  parameter Real c(unit="N.s/m2") = 0 "Damping coefficient";
equation
  f = c*abs(x)*v;
  annotation(Documentation(info = "<html><p>Loss per cycle grows with the third power of the amplitude.</p></html>"));
end DisplacementDependentDamping__Linear;
