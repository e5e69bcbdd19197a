within HystId.Effects;
block DisplacementDependentDamping__Sloped "Viscous damping that changes along the way"
  extends HystId.Interfaces.PartialEffect;
  parameter Real c1(unit="N.s/m2") = 0 "Change of damping with x";
  parameter Real c2(unit="N.s/m3") = 0 "Change of damping with x squared";
equation
  f = (c1*x + c2*x^2)*v;
  annotation(Documentation(info = "<html><p>Damping with an asymmetric part: even harmonics.</p></html>"));
end DisplacementDependentDamping__Sloped;
