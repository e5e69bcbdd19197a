within HystId.Effects;
block PositionDependentFriction "Dry friction whose level changes along the way"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Friction force at x = 0";
  parameter Real slope(unit="N/m") = 0 "Change of the friction force with x";
  parameter Real v_s(unit="m/s", min = 0) = 0.001 "Speed over which the friction force changes sign";
protected
  Real s(unit = "1") "Smoothed sign of the velocity";
equation
  s = tanh(v/v_s);
  f = (Fc + slope*x)*s;
  annotation(Documentation(info = "<html><p>Misaligned guide: even harmonics without a mean force.</p></html>"),
    __HystId_effect(
      title = "friction that depends on the position",
      family = "dry friction",
      transition = v_s,
      experiment = "repeat a small cycle at several mean positions"));
end PositionDependentFriction;
