within HystId.Effects;
block ViscoelasticRelaxation "Spring behind a dashpot (Maxwell branch)"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness of the branch";
  parameter Real tau(unit="s", min = 0) = 0.1 "Relaxation time";
protected
  Real z(unit = "m", start = 0, fixed = true) "Elongation of the spring";
equation
  der(z) = v - z/tau;
  f = k*z;
  annotation(Documentation(info = "<html><p>Linear, phase lagged: stiffness and loss depend on the frequency.</p></html>"),
    __HystId_effect(
      title = "viscoelastic relaxation",
      family = "inner dynamics",
      needs = {"speeds"},
      becomes = {End(law = "viscous_damping", of = tau, at = "bottom"), End(law = "linear_stiffness", of = tau, at = "top")},
      tells = {Telling(law = "hidden_mode", experiment = "hold a step and watch the force; sweep further up")},
      experiment = "hold a step and watch the force"));
end ViscoelasticRelaxation;
