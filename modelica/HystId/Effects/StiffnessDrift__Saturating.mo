within HystId.Effects;
block StiffnessDrift__Saturating "The elastic stiffness changes with time towards a new value"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m") = 0 "Change of stiffness in the end";
  parameter Real tau(unit="s", min = 0) = 1 "Time constant";
equation
  f = k*(1 - exp(-time/tau))*x;
  annotation(Documentation(info = "<html><p>Warming up of a rig.</p></html>"));
end StiffnessDrift__Saturating;
