within HystId.Effects;
block ContactLoss__Smooth "One-sided contact of rough surfaces: the kink is spread over a width"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m") = 0 "Stiffness added beyond the gap";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
  parameter Real w(unit="m", min = 0) = 0.0001 "Displacement over which the contact changes";
  parameter Integer side(min = -1, max = 1) = 1 "1: acts at large positive x, -1: at large negative x";
protected
  Real d(unit = "m") "Displacement beyond the gap";
equation
  d = side*x - gap;
  f = 0.5*side*k*(d + sqrt(d^2 + w^2));
  annotation(Documentation(info = "<html><p>Rough surfaces come into contact gradually.</p></html>"),
    __HystId_effect(
      threshold = gap,
      width = w,
      switch = side,
      becomes = {End(law = "preload", of = w, above = 1, per = "stroke")}));
end ContactLoss__Smooth;
