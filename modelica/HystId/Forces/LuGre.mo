within HystId.Forces;
block LuGre "LuGre friction: bristles that bend, with less friction at speed than at rest"
  extends Interfaces.PartialDissipativeForce;
  parameter Units.Stiffness sigma0(min = 0) = 5e4 "Stiffness of the bristles";
  parameter Units.Damping sigma1(min = 0) = 10 "Damping of the bristles";
  parameter Units.Force fc(min = 0) = 30 "Friction of fast sliding";
  parameter Units.Force fs(min = 0) = 37.5 "Friction before sliding, not below fc";
  parameter Units.Velocity vs(min = 0) = 0.01 "Speed at which friction falls";
protected
  Units.Displacement z(start = 0, fixed = true) "Deflection of the bristles";
  Units.Velocity dz "Its rate";
  Units.Force g "Friction of steady sliding at this speed";
equation
  g = fc + (fs - fc)*exp(-(v/vs)^2);
  dz = v - sigma0*abs(v)*z/g;
  der(z) = dz;
  f = sigma0*z + sigma1*dz;
  loss = f*v - sigma0*z*dz;
  annotation(Documentation(info = "<html><p>Canudas de Wit, Olsson, Astrom and Lischinsky (1995). Viscous friction is the
oscillator's B. The loss is what the motion brings beyond the energy sigma0 z^2/2 of the bristles; with sigma1 above
4 g/|v| it may be negative for moments.</p></html>"));
end LuGre;
