within HystId.Effects;
block Pinching__Lorentz "The hysteretic force is reduced around the middle, long tail"
  extends HystId.Interfaces.PartialEffect;
  parameter Real share(unit="1", min = 0, max = 1) = 0 "Share of the hysteretic force that is missing at x = 0";
  parameter Real w(unit="m", min = 0) = 0.001 "Half width of the pinched region";
equation
  f = -share*h/(1 + (x/w)^2);
  annotation(Documentation(info = "<html><p>Other shape of the pinched region.</p></html>"),
    __HystId_effect(
      becomes = {End(law = "hysteretic_friction", of = w, below = 1, per = "resolution")}));
end Pinching__Lorentz;
