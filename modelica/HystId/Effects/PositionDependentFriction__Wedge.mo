within HystId.Effects;
block PositionDependentFriction__Wedge "Dry friction whose level grows with the distance from the middle"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Friction force at x = 0";
  parameter Real slope(unit="N/m") = 0 "Change of the friction force with the distance from x = 0";
  parameter Real v_s(unit="m/s", min = 0) = 0.001 "Speed over which the friction force changes sign";
protected
  Real s(unit = "1") "Smoothed sign of the velocity";
equation
  s = tanh(v/v_s);
  f = (Fc + slope*abs(x))*s;
  annotation(Documentation(info = "<html><p>Wedge or cam: the loss factor does not depend on the amplitude.</p></html>"),
    __HystId_effect(
      transition = v_s));
end PositionDependentFriction__Wedge;
