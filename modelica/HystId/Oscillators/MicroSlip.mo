within HystId.Oscillators;
model MicroSlip "Oscillator with a bolted joint whose contact slips gradually"
  extends Interfaces.PartialOscillator;
  parameter Units.Stiffness Ks(min = 0) = 5e4 "Stiffness while sticking";
  parameter Units.Stiffness Kt(min = 0) = 5e3 "Slope of full slip, below Ks";
  parameter Units.Force fc(min = 0) = 37.5 "Force at which slip is full";
  parameter Units.Dimensionless kappa(min = 0, max = 0.999) = 0.5 "0: slip from the start, near 1: stick, then slip";
  Forces.MicroSlip law(Ks = Ks, Kt = Kt, fc = fc, kappa = kappa) "Hysteretic law";
equation
  law.x = x;
  law.v = v;
  f_h = law.f;
end MicroSlip;
