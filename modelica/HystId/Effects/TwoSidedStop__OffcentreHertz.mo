within HystId.Effects;
block TwoSidedStop__OffcentreHertz "Two stops with curved surfaces (power 3/2) and different gaps"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Secant stiffness at a penetration of d_ref";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes at the nearer stop";
  parameter Real lean(unit="1", min = -0.9, max = 0.9) = 0 "Share of its gap by which the positive stop is the farther one; below 0 the negative one";
protected
  constant Real d_ref(unit = "m") = 1e-3 "Penetration that the stiffness refers to";
  Real above(unit = "m") "Gap before the positive stop";
  Real below(unit = "m") "Gap before the negative stop";
  Real d(unit = "m") "Displacement beyond the gap, signed";
equation
  above = gap/(1 - max(lean, 0));
  below = gap/(1 - max(-lean, 0));
  d = noEvent(if x > above then x - above else if x < -below then x + below else 0);
  f = k*d*sqrt(abs(d)/d_ref);
  annotation(Documentation(info = "<html><p>Hertz contact on both sides of an off-centre clearance.</p></html>"),
    __HystId_effect(
      threshold = gap,
      becomes = {End(law = "contact_loss", of = gap, one_sided = true)}));
end TwoSidedStop__OffcentreHertz;
