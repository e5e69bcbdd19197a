within HystId.Forces;
block PecorariSolodov "Stick-slip contact of Pecorari and Solodov, valid for loops of amplitude x0"
  extends Interfaces.PartialDissipativeForce;
  parameter Units.Stiffness Ks = 5e3 "Stiffness while sticking";
  parameter Units.Displacement x0(min = 0) = 2e-2 "Amplitude of the loop";
  parameter Units.Displacement x1(min = 0) = 1e-2 "Displacement that parts stick from slip";
protected
  Units.Dimensionless s "Direction of motion";
  Units.Stiffness K "Stiffness at this point of the loop";
equation
  assert(abs(x) <= x0, "|x| = " + String(abs(x)) + " m exceeds x0: here the law of Pecorari and Solodov feeds energy in; "
    + "choose a larger x0, or the law Jenkins with fc = 0.5 Ks (x0 - x1)", AssertionLevel.warning);
  s = noEvent(sign(v));
  K = 0.5*Ks*(1 - s*noEvent(sign(x + x1*s)));
  f = K*x + K*x1*s + 0.5*Ks*(x0 - x1)*s;
  loss = noEvent(if K > 0 then 0 else f*v);
  annotation(Documentation(info = "<html><p>Pecorari and Solodov (2006), as its authors state it. Above the amplitude x0 the law
feeds energy into the oscillator, which then diverges: choose x0 not below the largest displacement, or take Jenkins
with fc = 0.5 Ks (x0 - x1), which has the same loop at amplitude x0 and is valid at every amplitude. The loss is the work of the branch that slips;
over a loop of amplitude x0 it is the work of the loop.</p></html>"));
end PecorariSolodov;
