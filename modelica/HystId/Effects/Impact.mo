within HystId.Effects;
block Impact "Hunt-Crossley contact with loss beyond a gap"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Secant stiffness at a penetration of d_ref";
  parameter Real c(unit="N.s/m2", min = 0) = 0 "Secant damping at a penetration of d_ref";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
  parameter Integer side(min = -1, max = 1) = 1 "1: acts at large positive x, -1: at large negative x, 0: at both";
protected
  constant Real d_ref(unit = "m") = 1e-3 "Penetration that the stiffness refers to";
  Real dp(unit = "m") "Penetration at positive x";
  Real dm(unit = "m") "Penetration at negative x";
equation
  dp = noEvent(if side >= 0 and x > gap then x - gap else 0);
  dm = noEvent(if side <= 0 and -x > gap then -x - gap else 0);
  f = (k + c*v)*dp*sqrt(dp/d_ref) - (k - c*v)*dm*sqrt(dm/d_ref);
  annotation(Documentation(info = "<html><p>Hunt and Crossley (1975): damping proportional to the penetration, so that the force starts at zero.</p></html>"),
    __HystId_effect(
      title = "impact",
      family = "contact beyond a gap",
      threshold = gap,
      switch = side,
      needs = {"speeds"},
      becomes = {End(law = "displacement_dependent_damping", of = c, over = k)},
      experiment = "add a test that reaches the contact at several speeds"));
end Impact;
