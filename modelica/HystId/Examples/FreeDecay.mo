within HystId.Examples;
model FreeDecay "A Jenkins oscillator released from 3 mm: it comes to rest off centre, held by its contact"
  Oscillators.Jenkins oscillator(x_start = 3e-3) "The oscillator";
equation
  oscillator.F = 0;
  annotation(experiment(StartTime = 0, StopTime = 1, Interval = 1e-4, Tolerance = 1e-6));
end FreeDecay;
