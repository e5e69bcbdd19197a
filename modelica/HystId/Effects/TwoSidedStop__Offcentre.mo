within HystId.Effects;
block TwoSidedStop__Offcentre "Two stops with different gaps"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness added beyond the gaps";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
  parameter Real gap_minus(unit="m", min = 0) = 0.001 "Gap on the negative side";
protected
  Real d(unit = "m") "Displacement beyond the gap, signed";
equation
  d = noEvent(if x > gap then x - gap else if x < -gap_minus then x + gap_minus else 0);
  f = k*d;
  annotation(Documentation(info = "<html><p>An off-centre clearance adds even harmonics.</p></html>"));
end TwoSidedStop__Offcentre;
