within HystId.Effects;
block HystereticFriction__BoucWen "Rate-independent hysteresis with free sharpness and shape"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Full friction force";
  parameter Real x_c(unit="m", min = 0) = 0.0001 "Displacement over which friction builds up";
  parameter Real n(unit="1", min = 0.6, max = 6) = 2 "Sharpness of the knee";
  parameter Real gamma(unit="1", min = 0, max = 1.5) = 0.5 "Share of the loading branch that softens; above 0.5 slim, below 0.5 hardening loops";
protected
  Real w(unit = "1", start = 0, fixed = true) "Friction force relative to its full value";
equation
  der(w) = (v - (gamma*abs(v)*w + (1 - gamma)*v*abs(w))*(abs(w) + 1e-9)^(n - 1))/x_c;
  f = Fc*w;
  annotation(Documentation(info = "<html><p>Bouc (1967), Wen (1976), scaled so that w tends to 1. The slopes of loading and
unloading differ by 2 gamma of the first one: below 0.04 of it no loss is claimed.</p></html>"),
    __HystId_effect(
      becomes = {End(law = "cubic_stiffness", of = gamma, below = 0.02),
        End(law = "coulomb_friction", of = x_c, below = 1, per = "resolution", fit = "equivalent")}));
end HystereticFriction__BoucWen;
