within HystId.Effects;
block Pinching__Force "The hysteretic force is reduced where it is small"
  extends HystId.Interfaces.PartialEffect;
  parameter Real share(unit="1", min = 0, max = 1) = 0 "Share of the hysteretic force that is missing at h = 0";
  parameter Real h_c(unit="N", min = 0) = 1 "Hysteretic force at which pinching ends";
equation
  f = -share*h*exp(-(h/h_c)^2);
  annotation(Documentation(info = "<html><p>Pinched region given by the force instead of the displacement (Baber and Noori, 1985).</p></html>"),
    __HystId_effect(
      becomes = {End(law = "backlash", of = share, above = 0.97, unless = "hysteresis", fit = "renamed")}));
end Pinching__Force;
