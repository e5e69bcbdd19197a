within HystId.Effects;
block PositionDependentFriction__Quadratic "Dry friction whose level changes along the way, with curvature"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Friction force at x = 0";
  parameter Real slope(unit="N/m") = 0 "Change of the friction force with x";
  parameter Real curvature(unit="N/m2") = 0 "Change of the friction force with x squared";
  parameter Real v_s(unit="m/s", min = 0) = 0.001 "Speed over which the friction force changes sign";
protected
  Real s(unit = "1") "Smoothed sign of the velocity";
equation
  s = tanh(v/v_s);
  f = (Fc + slope*x + curvature*x^2)*s;
  annotation(Documentation(info = "<html><p>Guide with a local change of the normal load.</p></html>"),
    __HystId_effect(
      transition = v_s));
end PositionDependentFriction__Quadratic;
