within HystId.Effects;
block AsymmetricFriction__Viscous "Friction with different levels and slopes in the two directions"
  extends HystId.Interfaces.PartialEffect;
  parameter Real F_forward(unit="N", min = 0) = 0 "Friction force at positive velocity";
  parameter Real F_backward(unit="N", min = 0) = 0 "Friction force at negative velocity";
  parameter Real B_difference(unit="N.s/m") = 0 "Viscous slope at positive velocity minus slope at negative velocity";
  parameter Real v_s(unit="m/s", min = 0) = 0.001 "Speed over which the friction force changes sign";
protected
  Real s(unit = "1") "Smoothed sign of the velocity";
equation
  s = tanh(v/v_s);
  f = noEvent(if s > 0 then F_forward*s else F_backward*s) + 0.5*B_difference*abs(v);
  annotation(Documentation(info = "<html><p>Worn guides: level and slope depend on the direction. Where the difference of the slopes outweighs
the friction, it is a damper that acts in one direction, and no friction.</p></html>"),
    __HystId_effect(
      transition = v_s,
      becomes = {End(law = "quadratic_damping", of = B_difference, over = F_forward)}));
end AsymmetricFriction__Viscous;
