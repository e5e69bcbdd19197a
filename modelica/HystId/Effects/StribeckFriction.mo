within HystId.Effects;
block StribeckFriction "Dry friction that falls with speed"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Friction force at high speed";
  parameter Real Fd(unit="N", min = 0) = 0 "Additional force at low speed";
  parameter Real v_d(unit="m/s", min = 0) = 0.01 "Speed at which the additional force has fallen to 1/e";
  parameter Real v_s(unit="m/s", min = 0) = 0.001 "Speed over which the friction force changes sign";
protected
  Real s(unit = "1") "Smoothed sign of the velocity";
equation
  s = tanh(v/v_s);
  f = (Fc + Fd*exp(-(v/v_d)^2))*s;
  annotation(Documentation(info = "<html><p>Stribeck curve, Gaussian form (Armstrong-Helouvry, 1991).</p></html>"),
    __HystId_effect(
      title = "friction that falls with speed",
      family = "dry friction",
      transition = v_s,
      becomes = {End(law = "coulomb_friction", of = v_d, below = 1, per = v_s)},
      needs = {"speeds"},
      tells = {Telling(law = "coulomb_friction", experiment = "record slow cycles through zero velocity")},
      experiment = "add slow cycles through zero velocity"));
end StribeckFriction;
