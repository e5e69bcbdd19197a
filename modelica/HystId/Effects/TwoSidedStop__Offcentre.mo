within HystId.Effects;
block TwoSidedStop__Offcentre "Two stops with different gaps"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness added beyond the gaps";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes at the nearer stop";
  parameter Real lean(unit="1", min = -0.9, max = 0.9) = 0 "Share of its gap by which the positive stop is the farther one; below 0 the negative one";
protected
  Real above(unit = "m") "Gap before the positive stop";
  Real below(unit = "m") "Gap before the negative stop";
  Real d(unit = "m") "Displacement beyond the gap, signed";
equation
  above = gap/(1 - max(lean, 0));
  below = gap/(1 - max(-lean, 0));
  d = noEvent(if x > above then x - above else if x < -below then x + below else 0);
  f = k*d;
  annotation(Documentation(info = "<html><p>An off-centre clearance adds even harmonics.</p></html>"),
    __HystId_effect(
      threshold = gap,
      becomes = {End(law = "contact_loss", of = gap, one_sided = true),
        End(law = "linear_stiffness", of = gap, below = 1, per = "resolution")}));
end TwoSidedStop__Offcentre;
