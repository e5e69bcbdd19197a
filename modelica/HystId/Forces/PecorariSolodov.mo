within HystId.Forces;
block PecorariSolodov "Stick-slip contact of Pecorari and Solodov, valid for loops of amplitude x0"
  extends Interfaces.PartialDissipativeForce;
  parameter Units.Stiffness Ks(min = 0) = 5e3 "Stiffness while sticking";
  parameter Units.Displacement x0(min = 0) = 2e-2 "Amplitude of the loop";
  parameter Units.Displacement x1(min = 0) = 1e-2 "Displacement that parts stick from slip";
  parameter Units.Velocity v_turn(min = 0) = 0 "Speed over which one branch gives way to the other; 0: at once";
protected
  Units.Dimensionless s "Direction of motion";
  Units.Stiffness K "Stiffness at this point of the loop, where it turns at once";
  Units.Force rising "Branch of positive velocity";
  Units.Force falling "Branch of negative velocity";
equation
  assert(abs(x) <= x0, "|x| = " + String(abs(x)) + " m exceeds x0: here the law of Pecorari and Solodov feeds energy in; "
    + "choose a larger x0, or the law Jenkins with fc = 0.5 Ks (x0 - x1)", AssertionLevel.warning);
  s = noEvent(if v_turn > 0 then tanh(v/v_turn) else sign(v));
  K = 0.5*Ks*(1 - s*noEvent(sign(x + x1*s)));
  rising = 0.5*Ks*((1 - noEvent(sign(x + x1)))*(x + x1) + (x0 - x1));
  falling = 0.5*Ks*((1 + noEvent(sign(x - x1)))*(x - x1) - (x0 - x1));
  f = noEvent(if v_turn > 0 then 0.5*(1 + s)*rising + 0.5*(1 - s)*falling else K*x + K*x1*s + 0.5*Ks*(x0 - x1)*s);
  loss = noEvent(if v_turn > 0 then 0.5*s*v*(rising - falling) else if K > 0 then 0 else f*v);
  annotation(Documentation(info = "<html><p>Pecorari and Solodov (2006), as its authors state it. Above the amplitude x0 the law
feeds energy into the oscillator, which then diverges: choose x0 not below the largest displacement, or take Jenkins
with fc = 0.5 Ks (x0 - x1), which has the same loop at amplitude x0 and is valid at every amplitude. The loss is the work of the branch that slips;
over a loop of amplitude x0 it is the work of the loop.</p><p>The force jumps where the velocity changes its sign short of the
amplitude x0. A real contact turns over a finite speed: with v_turn above zero the branches are blended by tanh(v/v_turn).
Solvers with error control need that too, since the jump is no event. The loss is then the work of the difference of the
branches; that of their mean is stored.</p></html>"));
end PecorariSolodov;
