within HystId.Effects;
block TwoSidedStop__Hertz "Two stops with curved surfaces (power 3/2)"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Secant stiffness at a penetration of d_ref";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
protected
  constant Real d_ref(unit = "m") = 1e-3 "Penetration that the stiffness refers to";
  Real d(unit = "m") "Displacement beyond the gap, signed";
equation
  d = noEvent(if x > gap then x - gap else if x < -gap then x + gap else 0);
  f = k*d*sqrt(abs(d)/d_ref);
  annotation(Documentation(info = "<html><p>Hertz contact on both sides.</p></html>"),
    __HystId_effect(
      threshold = gap,
      becomes = {End(law = "contact_loss", of = gap, one_sided = true)}));
end TwoSidedStop__Hertz;
