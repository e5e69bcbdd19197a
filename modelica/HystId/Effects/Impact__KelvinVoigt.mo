within HystId.Effects;
block Impact__KelvinVoigt "Spring and dashpot that act together beyond a gap"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Contact stiffness";
  parameter Real c(unit="N.s/m", min = 0) = 0 "Contact damping";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
  parameter Integer side(min = -1, max = 1) = 1 "1: acts at large positive x, -1: at large negative x, 0: at both";
equation
  f = noEvent(if side >= 0 and x > gap then k*(x - gap) + c*v else if side <= 0 and -x > gap then k*(x + gap) + c*v else 0);
  annotation(Documentation(info = "<html><p>The force jumps at contact, as the dashpot acts at once.</p></html>"),
    __HystId_effect(
      threshold = gap,
      switch = side,
      becomes = {End(law = "displacement_dependent_damping", of = c, over = k)}));
end Impact__KelvinVoigt;
