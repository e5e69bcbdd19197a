within HystId.Forces;
block Dahl "Dahl friction: stiffness fades as the force nears its limit"
  extends Interfaces.PartialDissipativeForce;
  parameter Units.Stiffness Ks(min = 0) = 5e4 "Stiffness at a reversal of motion";
  parameter Units.Force fc(min = 0) = 37.5 "Force of steady sliding";
protected
  Units.Force z(start = 0, fixed = true) "Friction force, between -fc and fc";
equation
  der(z) = Ks*(v - abs(v)*z/fc);
  f = z;
  loss = abs(v)*z^2/fc;
  annotation(Documentation(info = "<html><p>Dahl (1968), exponent 1. The stored energy is z^2/(2 Ks); what the motion
brings beyond it is the loss. Minor loops drift: the law has no return-point memory.</p></html>"));
end Dahl;
