within HystId.Effects;
block HiddenMode "A second mass on a spring and a dashpot"
  extends HystId.Interfaces.PartialEffect;
  parameter Real m2(unit="kg", min = 0) = 0 "Hidden mass";
  parameter Real f2(unit="Hz", min = 0) = 10 "Natural frequency of the hidden mass on its spring";
  parameter Real zeta(unit="1", min = 0.002, max = 1.5) = 0.05 "Damping ratio of the hidden mass";
protected
  Real y(unit = "m", start = 0, fixed = true) "Displacement of the hidden mass";
  Real w(unit = "m/s", start = 0, fixed = true) "Velocity of the hidden mass";
  Real omega(unit = "rad/s") "Angular natural frequency";
  Real g(unit = "m/s2") "Acceleration of the hidden mass";
equation
  omega = 2*3.141592653589793*f2;
  g = omega^2*(x - y) + 2*zeta*omega*(v - w);
  der(y) = w;
  der(w) = g;
  f = m2*g;
  annotation(Documentation(info = "<html><p>Resonance and antiresonance that no restoring force of x and v can give. What amplifies nothing (zeta from 0.5 on) is no resonance: a low-pass of the force channel does the same.</p></html>"),
    __HystId_effect(
      title = "hidden resonance",
      family = "inner dynamics",
      needs = {"speeds", "mass"},
      becomes = {End(law = "viscoelastic_relaxation", of = zeta, above = 1),
        End(law = "force_low_pass", of = zeta, above = 0.5, fit = "renamed"), End(law = "added_mass", of = f2, at = "top"),
        End(law = "", of = f2, at = "bottom")},
      experiment = "sweep further up and down in frequency"));
end HiddenMode;
