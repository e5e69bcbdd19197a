within HystIdTest;
model ForcedJenkins "HystId.Examples.ForcedJenkins"
  extends HystId.Examples.ForcedJenkins;
  annotation(experiment(StartTime = 0, StopTime = 1, Interval = 1e-4, Tolerance = 1e-6));
end ForcedJenkins;
