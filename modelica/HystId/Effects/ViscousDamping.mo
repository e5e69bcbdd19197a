within HystId.Effects;
block ViscousDamping "Damper that the model has not, or that acts for a while"
  extends HystId.Interfaces.PartialEffect;
  parameter Real c(unit="N.s/m", min = 0) = 0 "Damping coefficient";
equation
  f = c*v;
  annotation(Documentation(info = "<html><p>Proportional to the velocity. A damper of the model takes up what acts all the time.</p></html>"),
    __HystId_effect(
      title = "additional viscous damper",
      family = "linear damping",
      tells = {Telling(law = "viscoelastic_relaxation", experiment = "sweep further up while it acts")},
      experiment = "repeat the test with the damper taken off"));
end ViscousDamping;
