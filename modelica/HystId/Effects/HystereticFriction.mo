within HystId.Effects;
block HystereticFriction "Dry friction that builds up exponentially after each reversal (Dahl)"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Full friction force";
  parameter Real x_c(unit="m", min = 0) = 0.0001 "Displacement over which friction builds up";
protected
  Real w(unit = "1", start = 0, fixed = true) "Friction force relative to its full value";
equation
  der(w) = (v - abs(v)*w)/x_c;
  f = Fc*w;
  annotation(Documentation(info = "<html><p>Dahl (1968): rate-independent loops with memory of the last reversal.</p></html>"),
    __HystId_effect(
      title = "hysteretic friction",
      family = "dry friction",
      hysteretic = true,
      needs = {"reversals"},
      becomes = {End(law = "coulomb_friction", of = x_c, below = 1, per = "resolution", fit = "equivalent")},
      tells = {Telling(law = "coulomb_friction", experiment = "record slow reversals with more samples per millimetre")},
      experiment = "add reversals of motion of several sizes"));
end HystereticFriction;
