within HystId.Effects;
block CyclicDegradation "The hysteretic force weakens with the path travelled"
  extends HystId.Interfaces.PartialEffect;
  parameter Real share(unit="1", min = 0, max = 1) = 0 "Share of the hysteretic force that is lost in the end";
  parameter Real path_c(unit="m", min = 0) = 1 "Path over which most of the change happens";
protected
  Real s(unit = "m", start = 0, fixed = true) "Path travelled";
equation
  der(s) = abs(v);
  f = -share*(1 - exp(-s/path_c))*h;
  annotation(Documentation(info = "<html><p>Wear and strength degradation: monotone in the path, not in time.</p></html>"),
    __HystId_effect(
      title = "degradation with use",
      family = "change with time or use",
      path = path_c,
      lasting = true,
      experiment = "repeat the first test after many cycles"));
end CyclicDegradation;
