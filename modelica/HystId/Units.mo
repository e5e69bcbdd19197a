within HystId;
package Units "SI types of this library (aliases, so that nothing outside it has to be loaded)"
  type Time = Real(final quantity = "Time", final unit = "s");
  type Displacement = Real(final quantity = "Length", final unit = "m");
  type Velocity = Real(final quantity = "Velocity", final unit = "m/s");
  type Acceleration = Real(final quantity = "Acceleration", final unit = "m/s2");
  type Force = Real(final quantity = "Force", final unit = "N");
  type Power = Real(final quantity = "Power", final unit = "W");
  type Mass = Real(final quantity = "Mass", final unit = "kg", min = 0);
  type Stiffness = Real(final quantity = "Stiffness", final unit = "N/m");
  type Damping = Real(final quantity = "Damping", final unit = "N.s/m");
  type Dimensionless = Real(final unit = "1");
end Units;
