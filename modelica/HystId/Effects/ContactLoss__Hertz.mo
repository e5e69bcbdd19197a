within HystId.Effects;
block ContactLoss__Hertz "One-sided contact with curved surfaces (power 3/2) beyond a gap"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m") = 0 "Secant stiffness at a penetration of d_ref";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
  parameter Integer side(min = -1, max = 1) = 1 "1: acts at large positive x, -1: at large negative x";
protected
  constant Real d_ref(unit = "m") = 1e-3 "Penetration that the stiffness refers to";
  Real d(unit = "m") "Displacement beyond the gap, not negative";
equation
  d = noEvent(if side*x > gap then side*x - gap else 0);
  f = side*k*d*sqrt(d/d_ref);
  annotation(Documentation(info = "<html><p>Hertz contact: force with the power 3/2 of the approach.</p></html>"),
    __HystId_effect(
      threshold = gap,
      switch = side));
end ContactLoss__Hertz;
