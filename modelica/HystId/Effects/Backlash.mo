within HystId.Effects;
block Backlash "Free play: a spring of the baseline is missing inside a gap"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness that is missing inside the gap";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
equation
  f = -k*noEvent(if x > gap then gap else if x < -gap then -gap else x);
  annotation(Documentation(info = "<html><p>Strongest at small amplitude. Differs from two stops by a linear spring alone.</p></html>"),
    __HystId_effect(
      title = "free play",
      family = "contact beyond a gap",
      threshold = gap,
      alike = {Alike(law = "two_sided_stop", unless = "pinching", title = "play between two stops")},
      tells = {Telling(law = "two_sided_stop",
        experiment = "measure the stiffness at very small displacement: free play is soft")},
      experiment = "add a test of which the displacement stays within the suspected play"));
end Backlash;
