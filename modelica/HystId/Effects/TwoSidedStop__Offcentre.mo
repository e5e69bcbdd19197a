within HystId.Effects;
block TwoSidedStop__Offcentre "Two stops with different gaps"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness added beyond the gaps";
  parameter Real gap(unit="m", min = 0) = 0.001 "Mean displacement at which contact changes";
  parameter Real lean(unit="1", min = -0.9, max = 0.9) = 0 "Share by which the positive gap is the larger one";
protected
  Real d(unit = "m") "Displacement beyond the gap, signed";
equation
  d = noEvent(if x > (1 + lean)*gap then x - (1 + lean)*gap else if x < -(1 - lean)*gap then x + (1 - lean)*gap else 0);
  f = k*d;
  annotation(Documentation(info = "<html><p>An off-centre clearance adds even harmonics.</p></html>"),
    __HystId_effect(
      threshold = gap,
      becomes = {End(law = "contact_loss", of = gap, one_sided = true),
        End(law = "linear_stiffness", of = gap, below = 1, per = "resolution")}));
end TwoSidedStop__Offcentre;
