within HystId.Oscillators;
model PecorariSolodov "Oscillator with the stick-slip law of Pecorari and Solodov"
  extends Interfaces.PartialOscillator;
  parameter Units.Stiffness Ks(min = 0) = 5e3 "Stiffness while sticking";
  parameter Units.Displacement x0(min = 0) = 2e-2 "Amplitude of the loop: not below the largest displacement";
  parameter Units.Displacement x1(min = 0) = 1e-2 "Displacement that parts stick from slip";
  parameter Units.Velocity v_turn(min = 0) = 0 "Speed over which the contact turns; 0: at once";
  Forces.PecorariSolodov law(Ks = Ks, x0 = x0, x1 = x1, v_turn = v_turn) "Hysteretic law";
equation
  law.x = x;
  law.v = v;
  f_h = law.f;
end PecorariSolodov;
