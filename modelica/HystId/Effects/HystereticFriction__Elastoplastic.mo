within HystId.Effects;
block HystereticFriction__Elastoplastic "Dry friction behind a spring: linear rise, then slip"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Full friction force";
  parameter Real x_c(unit="m", min = 0) = 0.0001 "Displacement over which friction builds up";
protected
  Boolean slips "The slider follows the motion";
  Real z(unit = "m", start = 0, fixed = true) "Deflection of the spring";
equation
  slips = (z >= x_c and v > 0) or (z <= -x_c and v < 0);
  der(z) = if slips then 0 else v;
  f = Fc*z/x_c;
  annotation(Documentation(info = "<html><p>Jenkins (1962): a spring in series with a dry slider.</p></html>"),
    __HystId_effect(
      becomes = {End(law = "coulomb_friction", of = x_c, below = 1, per = "resolution", fit = "equivalent")}));
end HystereticFriction__Elastoplastic;
