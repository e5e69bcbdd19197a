within HystId.Effects;
block StribeckFriction__Lorentz "Dry friction that falls with speed, long tail"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Friction force at high speed";
  parameter Real Fd(unit="N", min = 0) = 0 "Additional force at low speed";
  parameter Real v_d(unit="m/s", min = 0) = 0.01 "Speed at which half of the additional force is left";
  parameter Real v_s(unit="m/s", min = 0) = 0.001 "Speed over which the friction force changes sign";
protected
  Real s(unit = "1") "Smoothed sign of the velocity";
equation
  s = tanh(v/v_s);
  f = (Fc + Fd/(1 + (v/v_d)^2))*s;
  annotation(Documentation(info = "<html><p>Stribeck curve, Lorentzian form (Hess and Soom, 1990).</p></html>"),
    __HystId_effect(
      transition = v_s,
      becomes = {End(law = "coulomb_friction", of = v_d, below = 1, per = v_s)}));
end StribeckFriction__Lorentz;
