within HystId.Effects;
block HystereticFriction__Elastoplastic "Dry friction behind a spring: linear rise, then slip"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Full friction force";
  parameter Real x_c(unit="m", min = 0) = 0.0001 "Displacement over which friction builds up";
protected
  Real w(unit = "1", start = 0, fixed = true) "Friction force relative to its full value";
equation
  der(w) = noEvent(if w > 1 and v > 0 then v/x_c*(1 - w)*2 else if w < -1 and v < 0 then -v/x_c*(-1 - w)*2 else v/x_c);
  f = Fc*w;
  annotation(Documentation(info = "<html><p>Jenkins element with a corner that a solver can follow.</p></html>"));
end HystereticFriction__Elastoplastic;
