within HystId.Components;
block TimeWindow "Factor that lets a force act for a part of the time: 0, then 1, then 0 again"
  parameter Units.Time t_on = 0 "Begins to rise";
  parameter Units.Time t_off = 1 "Is 0 again";
  parameter Units.Time t_ramp = 0.05 "Duration of the rise, and of the fall";
  output Units.Dimensionless y "Factor, 0 to 1";
equation
  y = noEvent(max(0, min(1, min((time - t_on)/t_ramp, (t_off - time)/t_ramp))));
  annotation(Documentation(info = "<html><p>A bolt that works loose and is tightened again, a cooling jet, a door that is
opened during a test: physics that is there for a part of the recording only.</p></html>"));
end TimeWindow;
