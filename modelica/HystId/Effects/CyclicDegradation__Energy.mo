within HystId.Effects;
block CyclicDegradation__Energy "The hysteretic force weakens with the energy that passed through it"
  extends HystId.Interfaces.PartialEffect;
  parameter Real share(unit="1", min = 0, max = 1) = 0 "Share of the hysteretic force that is lost in the end";
  parameter Real E_c(unit="J", min = 0) = 1 "Energy over which most of the change happens";
protected
  Real E(unit = "J", start = 0, fixed = true) "Energy that passed through the hysteretic element";
equation
  der(E) = abs(h*v);
  f = -share*(1 - exp(-E/E_c))*h;
  annotation(Documentation(info = "<html><p>Baber and Wen (1981): degradation as a function of energy.</p></html>"));
end CyclicDegradation__Energy;
