within HystId.Oscillators;
model BoucWen "Oscillator with Bouc-Wen hysteresis"
  extends Interfaces.PartialOscillator;
  parameter Units.Stiffness alpha(min = 0) = 5e4 "Stiffness at z = 0";
  parameter Real beta(unit = "1/m", min = 0) = 1e3 "Scale of the bend (with nu = 1)";
  parameter Units.Dimensionless gamma = 0.8 "Share that depends on the direction of motion alone";
  parameter Units.Dimensionless delta = -1.1 "Share that depends on loading or unloading";
  parameter Units.Dimensionless nu(min = 1, max = 10) = 1 "Sharpness of the bend; a corner where large";
  Forces.BoucWen law(alpha = alpha, beta = beta, gamma = gamma, delta = delta, nu = nu) "Hysteretic law";
equation
  law.x = x;
  law.v = v;
  f_h = law.f;
end BoucWen;
