within HystId.Interfaces;
partial model PartialOscillator "One mass on a restoring force: m a + R = F"
  parameter Units.Mass m(min = 0) = 1 "Mass, from weighing";
  parameter Units.Damping B(min = 0) = 10 "Viscous damping";
  parameter Units.Stiffness Kl = 1e4 "Linear stiffness";
  parameter Units.Displacement x_start = 0 "Displacement at the start";
  parameter Units.Velocity v_start = 0 "Velocity at the start";
  input Units.Force F "Excitation, in the direction of x";
  output Units.Displacement x(start = x_start, fixed = true) "Displacement";
  output Units.Velocity v(start = v_start, fixed = true) "Velocity";
  output Units.Acceleration a "Acceleration";
  output Units.Force R "Restoring force, opposes motion as a spring does";
  Units.Force f_h "Hysteretic force, part of R";
  Units.Force f_effects = 0 "Sum of the effects added to the model, part of R";
equation
  der(x) = v;
  der(v) = a;
  m*a + R = F;
  R = B*v + Kl*x + f_h + f_effects;
end PartialOscillator;
