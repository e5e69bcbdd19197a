within HystId.Oscillators;
model Iwan "Oscillator with contact that slips little by little"
  extends Interfaces.PartialOscillator;
  parameter Integer N(min = 1) = 8 "Number of sliders";
  parameter Units.Stiffness Ks(min = 0) = 5e4 "Stiffness while all sliders stick";
  parameter Units.Force fc(min = 0) = 37.5 "Force at which all sliders slip";
  Forces.Iwan law(N = N, Ks = Ks, fc = fc) "Hysteretic law";
equation
  law.x = x;
  law.v = v;
  f_h = law.f;
end Iwan;
