within HystId.Oscillators;
model LuGre "Oscillator with LuGre friction"
  extends Interfaces.PartialOscillator;
  parameter Units.Stiffness sigma0(min = 0) = 5e4 "Stiffness of the bristles";
  parameter Units.Damping sigma1(min = 0) = 10 "Damping of the bristles";
  parameter Units.Force fc(min = 0) = 30 "Friction of fast sliding";
  parameter Units.Force fs(min = 0) = 37.5 "Friction before sliding, not below fc";
  parameter Units.Velocity vs(min = 0) = 0.01 "Speed at which friction falls";
  Forces.LuGre law(sigma0 = sigma0, sigma1 = sigma1, fc = fc, fs = fs, vs = vs) "Hysteretic law";
equation
  law.x = x;
  law.v = v;
  f_h = law.f;
end LuGre;
