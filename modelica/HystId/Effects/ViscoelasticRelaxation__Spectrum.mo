within HystId.Effects;
block ViscoelasticRelaxation__Spectrum "Three Maxwell branches a factor of five apart"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness of each branch";
  parameter Real tau(unit="s", min = 0) = 0.1 "Middle relaxation time";
protected
  Real z1(unit = "m", start = 0, fixed = true) "Elongation of spring 1";
  Real z2(unit = "m", start = 0, fixed = true) "Elongation of spring 2";
  Real z3(unit = "m", start = 0, fixed = true) "Elongation of spring 3";
equation
  der(z1) = v - 5*z1/tau;
  der(z2) = v - z2/tau;
  der(z3) = v - 0.2*z3/tau;
  f = k*(z1 + z2 + z3);
  annotation(Documentation(info = "<html><p>A spread of relaxation times, close to a fractional (spring-pot) element.</p></html>"));
end ViscoelasticRelaxation__Spectrum;
