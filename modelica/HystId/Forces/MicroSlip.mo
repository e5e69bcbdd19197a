within HystId.Forces;
block MicroSlip "Bolted joint whose contact slips gradually (Valanis)"
  extends Interfaces.PartialDissipativeForce;
  parameter Units.Stiffness Ks(min = 0) = 5e4 "Stiffness while sticking";
  parameter Units.Stiffness Kt(min = 0) = 5e3 "Slope of full slip, below Ks";
  parameter Units.Force fc(min = 0) = 37.5 "Force at which slip is full";
  parameter Units.Dimensionless kappa(min = 0, max = 0.999) = 0.5 "0: slip from the start, near 1: stick, then slip";
protected
  Units.Force z(start = 0, fixed = true) "Force in the contact beyond the slope of full slip";
  Units.Dimensionless s "Contact force against the motion, in parts of fc";
equation
  s = -sign(v)*z/fc;
  der(z) = v*(Ks*(1 + s)/(1 + kappa*s) - Kt);
  f = Kt*x + z;
  loss = Ks*(1 - kappa)*abs(v)*z^2/(fc*(1 + kappa*s)*(Ks - Kt));
  annotation(Documentation(info = "<html><p>Valanis (1971) as used for bolted joints by Gaul and Lenz (1997). The stored
energy of the contact is z^2/(2 (Ks - Kt)).</p></html>"));
end MicroSlip;
