within HystIdTest;
model LawComparison "HystId.Examples.LawComparison"
  extends HystId.Examples.LawComparison;
  annotation(experiment(StartTime = 0, StopTime = 1, Interval = 1e-4, Tolerance = 1e-6));
end LawComparison;
