within HystId.Effects;
block LinearStiffness "Spring that the model has not, or that acts for a while"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness";
equation
  f = k*x;
  annotation(Documentation(info = "<html><p>Proportional to the displacement. A spring of the model takes up what acts all the time.</p></html>"),
    __HystId_effect(
      title = "additional linear spring",
      family = "linear stiffness",
      tells = {Telling(law = "two_sided_stop", experiment = "add a test of smaller displacement while it acts"),
        Telling(law = "viscoelastic_relaxation", experiment = "hold a step while it acts, and watch the force")},
      experiment = "repeat the test with the support taken off"));
end LinearStiffness;
