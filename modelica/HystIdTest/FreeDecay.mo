within HystIdTest;
model FreeDecay "HystId.Examples.FreeDecay"
  extends HystId.Examples.FreeDecay;
  annotation(experiment(StartTime = 0, StopTime = 1, Interval = 1e-4, Tolerance = 1e-6));
end FreeDecay;
