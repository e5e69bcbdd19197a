within HystId.Effects;
block BilinearStiffness__Threshold "The slope falls beyond a displacement on both sides: a spring that yields or saturates"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness that is lost beyond the break point";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which the slope changes";
protected
  Real d(unit = "m") "Displacement beyond the break point, signed";
equation
  d = noEvent(if x > gap then x - gap else if x < -gap then x + gap else 0);
  f = -k*d;
  annotation(Documentation(info = "<html><p>Elastic: loading and unloading run along the same two lines. Opposite of two stops.</p></html>"),
    __HystId_effect(
      threshold = gap,
      becomes = {End(law = "linear_stiffness", of = gap, below = 1, per = "resolution")}));
end BilinearStiffness__Threshold;
