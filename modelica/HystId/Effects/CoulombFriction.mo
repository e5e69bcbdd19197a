within HystId.Effects;
block CoulombFriction "Dry friction"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Friction force";
  parameter Real v_s(unit="m/s", min = 0) = 0.001 "Speed over which the friction force changes sign";
equation
  f = Fc*tanh(v/v_s);
  annotation(Documentation(info = "<html><p>Loss per cycle proportional to the amplitude, independent of the frequency.</p></html>"),
    __HystId_effect(
      title = "dry friction",
      family = "dry friction",
      transition = v_s,
      experiment = "add a test at low amplitude, where friction is a larger part of the loss"));
end CoulombFriction;
