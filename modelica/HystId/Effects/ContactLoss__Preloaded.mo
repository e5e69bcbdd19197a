within HystId.Effects;
block ContactLoss__Preloaded "A contact of curved surfaces (power 3/2) under preload, which opens beyond a gap on one side"
  extends HystId.Interfaces.PartialEffect;
  parameter Real N(unit="N", min = 0) = 0 "Preload, lost where the contact is open";
  parameter Real gap(unit="m", min = 0) = 0.001 "Approach under the preload: displacement at which the contact opens";
  parameter Integer side(min = -1, max = 1) = 1 "1: opens at large positive x, -1: at large negative x";
protected
  Real u(unit = "1") "Approach over that at rest, not negative";
equation
  u = noEvent(if side*x < gap then 1 - side*x/gap else 0);
  f = side*N*(1 - u*sqrt(u));
  annotation(Documentation(info = "<html><p>Hertz contact between surfaces that are pressed together: its stiffness falls as they part, and is zero beyond
  the approach (Nayak 1972, J. Sound Vib. 22(3), 297-322).</p></html>"),
    __HystId_effect(
      threshold = gap,
      switch = side));
end ContactLoss__Preloaded;
