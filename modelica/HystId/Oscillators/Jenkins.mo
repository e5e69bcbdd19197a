within HystId.Oscillators;
model Jenkins "Oscillator with stick-slip contact that remembers its turning points"
  extends Interfaces.PartialOscillator;
  parameter Units.Stiffness Ks(min = 0) = 5e4 "Stiffness while the contact sticks";
  parameter Units.Force fc(min = 0) = 37.5 "Force at which the contact slips";
  Forces.Jenkins law(Ks = Ks, fc = fc) "Hysteretic law";
equation
  law.x = x;
  law.v = v;
  f_h = law.f;
end Jenkins;
