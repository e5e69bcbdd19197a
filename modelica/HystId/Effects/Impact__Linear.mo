within HystId.Effects;
block Impact__Linear "Linear contact with loss beyond a gap"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Contact stiffness";
  parameter Real c(unit="N.s/m2", min = 0) = 0 "Contact damping";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
  parameter Integer side(min = -1, max = 1) = 1 "1: acts at large positive x, -1: at large negative x, 0: at both";
protected
  Real dp(unit = "m") "Penetration at positive x";
  Real dm(unit = "m") "Penetration at negative x";
equation
  dp = noEvent(if side >= 0 and x > gap then x - gap else 0);
  dm = noEvent(if side <= 0 and -x > gap then -x - gap else 0);
  f = (k + c*v)*dp - (k - c*v)*dm;
  annotation(Documentation(info = "<html><p>Linear stiffness, damping proportional to the penetration.</p></html>"),
    __HystId_effect(
      threshold = gap,
      switch = side,
      becomes = {End(law = "displacement_dependent_damping", of = c, over = k)}));
end Impact__Linear;
