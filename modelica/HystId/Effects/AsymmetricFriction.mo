within HystId.Effects;
block AsymmetricFriction "Dry friction of different level in the two directions"
  extends HystId.Interfaces.PartialEffect;
  parameter Real F_forward(unit="N", min = 0) = 0 "Friction force at positive velocity";
  parameter Real F_backward(unit="N", min = 0) = 0 "Friction force at negative velocity";
  parameter Real v_s(unit="m/s", min = 0) = 0.001 "Speed over which the friction force changes sign";
protected
  Real s(unit = "1") "Smoothed sign of the velocity";
equation
  s = tanh(v/v_s);
  f = noEvent(if s > 0 then F_forward*s else F_backward*s);
  annotation(Documentation(info = "<html><p>Dry friction plus a constant force, but for the region around zero velocity.</p></html>"),
    __HystId_effect(
      title = "friction that depends on the direction",
      family = "dry friction",
      transition = v_s,
      tells = {Telling(law = "preload", experiment = "hold it still after slow motion from either side, and tilt it")},
      experiment = "move slowly in both directions over the same places"));
end AsymmetricFriction;
