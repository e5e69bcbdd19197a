within HystId.Examples;
model ForcedJenkins "Steady vibration of a Jenkins oscillator under a harmonic force: odd harmonics in R"
  parameter Units.Force amplitude = 60 "Amplitude of the excitation";
  parameter Real frequency(unit = "Hz") = 20 "Frequency of the excitation";
  Oscillators.Jenkins oscillator "The oscillator";
protected
  constant Real pi = 3.141592653589793;
equation
  oscillator.F = amplitude*sin(2*pi*frequency*time);
  annotation(experiment(StartTime = 0, StopTime = 1, Interval = 1e-4, Tolerance = 1e-6));
end ForcedJenkins;
