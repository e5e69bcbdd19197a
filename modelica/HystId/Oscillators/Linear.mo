within HystId.Oscillators;
model Linear "Linear oscillator"
  extends Interfaces.PartialOscillator;
equation
  f_h = 0;
end Linear;
