within HystId.Forces;
block BoucWen "Bouc-Wen hysteresis"
  extends Interfaces.PartialDissipativeForce;
  parameter Units.Stiffness alpha(min = 0) = 5e4 "Stiffness at z = 0";
  parameter Real beta(unit = "1/m", min = 0) = 1e3 "Scale of the bend (with nu = 1)";
  parameter Units.Dimensionless gamma = 0.8 "Share that depends on the direction of motion alone";
  parameter Units.Dimensionless delta = -1.1 "Share that depends on loading or unloading";
  parameter Units.Dimensionless nu(min = 1, max = 10) = 1 "Sharpness of the bend; a corner where large";
protected
  Units.Force z(start = 0, fixed = true) "Hysteretic force";
  Real bend(unit = "N/s") "What the bend takes from the rate of z";
equation
  bend = beta*(gamma*abs(v)*abs(z)^nu*sign(z) + delta*v*abs(z)^nu);
  der(z) = alpha*v - bend;
  f = z;
  loss = z*bend/alpha;
  annotation(Documentation(info = "<html><p>Bouc (1967), Wen (1976). |z|^(nu-1) z is written |z|^nu sign(z), so that the
derivatives stay finite at z = 0. The stored energy is z^2/(2 alpha); the loss is never negative where gamma &gt;= |delta|,
elsewhere the branches bulge and the loss is positive over a whole loop only. With nu other than 1 the unit of beta is
(1/m) N^(1-nu).</p></html>"));
end BoucWen;
