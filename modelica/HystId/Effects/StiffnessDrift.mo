within HystId.Effects;
block StiffnessDrift "The elastic stiffness changes steadily with time"
  extends HystId.Interfaces.PartialEffect;
  parameter Real rate(unit="N/(m.s)") = 0 "Change of stiffness per time";
equation
  f = rate*time*x;
  annotation(Documentation(info = "<html><p>Heating: monotone in time, also while the structure rests.</p></html>"),
    __HystId_effect(
      title = "stiffness that changes with time",
      family = "change with time or use",
      lasting = true,
      tells = {Telling(law = "cyclic_degradation", experiment = "let it rest between two tests: time passes without a path")},
      experiment = "repeat the first test some time later"));
end StiffnessDrift;
