within HystId.Effects;
block QuadraticStiffness "Asymmetric spring, even in x"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k2(unit="N/m2") = 0 "Quadratic stiffness";
equation
  f = k2*x^2;
  annotation(Documentation(info = "<html><p>Gives a mean force and even harmonics that grow with the amplitude.</p></html>"),
    __HystId_effect(
      title = "asymmetric spring",
      family = "nonlinear spring",
      tells = {Telling(law = "bilinear_stiffness", experiment = "does the second harmonic grow with the amplitude")},
      experiment = "push and pull from the middle by the same amounts"));
end QuadraticStiffness;
