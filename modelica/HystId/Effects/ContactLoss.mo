within HystId.Effects;
block ContactLoss "A contact spring opens (k < 0) or closes (k > 0) beyond a gap on one side"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m") = 0 "Stiffness added beyond the gap";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
  parameter Integer side(min = -1, max = 1) = 1 "1: acts at large positive x, -1: at large negative x";
protected
  Real d(unit = "m") "Displacement beyond the gap, not negative";
equation
  d = noEvent(if side*x > gap then side*x - gap else 0);
  f = side*k*d;
  annotation(Documentation(info = "<html><p>Nothing below the gap, then a kink: even and odd harmonics with an onset in amplitude.</p></html>"),
    __HystId_effect(
      title = "one-sided contact beyond a gap",
      family = "contact beyond a gap",
      threshold = gap,
      switch = side,
      experiment = "add a test of larger displacement, so that the contact opens or closes"));
end ContactLoss;
