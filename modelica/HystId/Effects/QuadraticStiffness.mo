within HystId.Effects;
block QuadraticStiffness "Asymmetric spring, even in x"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k2(unit="N/m2") = 0 "Quadratic stiffness";
equation
  f = k2*x^2;
  annotation(Documentation(info = "<html><p>Gives a mean force and even harmonics that grow with the amplitude.</p></html>"));
end QuadraticStiffness;
