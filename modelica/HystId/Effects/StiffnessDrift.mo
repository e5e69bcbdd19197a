within HystId.Effects;
block StiffnessDrift "The elastic stiffness changes steadily with time"
  extends HystId.Interfaces.PartialEffect;
  parameter Real rate(unit="N/(m.s)") = 0 "Change of stiffness per time";
equation
  f = rate*time*x;
  annotation(Documentation(info = "<html><p>Heating: monotone in time, also while the structure rests.</p></html>"));
end StiffnessDrift;
