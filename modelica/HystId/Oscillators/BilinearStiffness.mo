within HystId.Oscillators;
model BilinearStiffness "Oscillator with a breathing crack (its stiffness law stands for the hysteretic one)"
  extends Interfaces.PartialOscillator;
  parameter Units.Stiffness k_open(min = 0) = 8e3 "Stiffness for x > 0";
  parameter Units.Stiffness k_closed(min = 0) = 1e4 "Stiffness for x < 0";
  Forces.BilinearStiffness law(k_open(min = 0) = k_open, k_closed(min = 0) = k_closed) "Hysteretic law";
equation
  law.x = x;
  law.v = v;
  f_h = law.f;
end BilinearStiffness;
