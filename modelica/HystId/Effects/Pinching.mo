within HystId.Effects;
block Pinching "The hysteretic force is reduced around the middle of the stroke"
  extends HystId.Interfaces.PartialEffect;
  parameter Real share(unit="1", min = 0, max = 1) = 0 "Share of the hysteretic force that is missing at x = 0";
  parameter Real w(unit="m", min = 0) = 0.001 "Half width of the pinched region";
equation
  f = -share*h*exp(-(x/w)^2);
  annotation(Documentation(info = "<html><p>Slip of a bolted or reinforced joint before its faces bear.</p></html>"),
    __HystId_effect(
      title = "pinching",
      becomes = {End(law = "hysteretic_friction", of = w, below = 1, per = "resolution")},
      experiment = "cycle through zero at several amplitudes"));
end Pinching;
