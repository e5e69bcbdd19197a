within HystId.Oscillators;
model Dahl "Oscillator with Dahl friction"
  extends Interfaces.PartialOscillator;
  parameter Units.Stiffness Ks(min = 0) = 5e4 "Stiffness at a reversal of motion";
  parameter Units.Force fc(min = 0) = 37.5 "Force of steady sliding";
  Forces.Dahl law(Ks = Ks, fc = fc) "Hysteretic law";
equation
  law.x = x;
  law.v = v;
  f_h = law.f;
end Dahl;
