within HystId.Effects;
block Impact__KelvinVoigt "Spring and dashpot that push together beyond a gap"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Contact stiffness";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
  parameter Real tau(unit="s", min = 0) = 0.001 "Contact damping over contact stiffness";
  parameter Integer side(min = -1, max = 1) = 1 "1: acts at large positive x, -1: at large negative x, 0: at both";
equation
  f = k*noEvent(if side >= 0 and x > gap then max(x - gap + tau*v, 0) else if side <= 0 and -x > gap then min(x + gap + tau*v, 0) else 0);
  annotation(Documentation(info = "<html><p>The force jumps at contact, as the dashpot acts at once. Bodies that part do not pull: contact ends before the
gap is passed again.</p></html>"),
    __HystId_effect(
      threshold = gap,
      switch = side,
      becomes = {End(law = "displacement_dependent_damping", of = tau, at = "top")}));
end Impact__KelvinVoigt;
