within HystId.Effects;
block CubicStiffness "Hardening (k3 > 0) or softening (k3 < 0) spring, odd"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k3(unit="N/m3") = 0 "Cubic stiffness";
equation
  f = k3*x^3;
  annotation(Documentation(info = "<html><p>Duffing spring. Harmonics of f/F grow with the square of the amplitude.</p></html>"),
    __HystId_effect(
      title = "hardening or softening spring",
      family = "nonlinear spring",
      experiment = "add a test of larger amplitude"));
end CubicStiffness;
