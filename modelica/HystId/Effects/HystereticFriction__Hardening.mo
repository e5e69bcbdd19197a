within HystId.Effects;
block HystereticFriction__Hardening "Rate-independent hysteresis without a plateau: the loop stiffens while loading"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness at reversal";
  parameter Real x_c(unit="m", min = 0) = 0.0001 "Displacement over which friction builds up";
  parameter Real ratio(unit="1", min = 0.2, max = 5) = 1.2 "Softening on unloading relative to hardening on loading";
protected
  Real z(unit = "m", start = 0, fixed = true) "Hysteretic displacement";
equation
  der(z) = v - (ratio*abs(v)*z - v*abs(z))/x_c;
  f = k*z;
  annotation(Documentation(info = "<html><p>Bouc-Wen loop with negative sum of the shape constants.</p></html>"),
    __HystId_effect(
      becomes = {End(law = "coulomb_friction", of = x_c, below = 1, per = "resolution", fit = "equivalent")}));
end HystereticFriction__Hardening;
