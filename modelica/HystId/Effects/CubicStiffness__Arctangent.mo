within HystId.Effects;
block CubicStiffness__Arctangent "Softening spring that saturates beyond x_c"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m") = 0 "Stiffness that is lost at large displacement";
  parameter Real x_c(unit="m", min = 0) = 0.001 "Displacement at which the spring saturates";
equation
  f = k*(x_c*atan(x/x_c) - x);
  annotation(Documentation(info = "<html><p>For springs that soften; reduces to the cubic spring for x much below x_c.</p></html>"),
    __HystId_effect(
      becomes = {End(law = "linear_stiffness", of = x_c, below = 1, per = "resolution")}));
end CubicStiffness__Arctangent;
