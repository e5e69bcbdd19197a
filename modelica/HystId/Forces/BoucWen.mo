within HystId.Forces;
block BoucWen "Bouc-Wen hysteresis"
  extends Interfaces.PartialForce;
  parameter Units.Stiffness alpha = 5e4 "Stiffness at z = 0";
  parameter Real beta(unit = "1/m") = 1e3 "Scale of the bend (with nu = 1)";
  parameter Units.Dimensionless gamma = 0.8 "Share that depends on the direction of motion alone";
  parameter Units.Dimensionless delta = -1.1 "Share that depends on loading or unloading";
  parameter Units.Dimensionless nu(min = 1) = 1 "Sharpness of the bend";
protected
  Units.Force z(start = 0, fixed = true) "Hysteretic force";
equation
  der(z) = alpha*v - beta*(gamma*abs(v)*abs(z)^nu*sign(z) + delta*v*abs(z)^nu);
  f = z;
end BoucWen;
