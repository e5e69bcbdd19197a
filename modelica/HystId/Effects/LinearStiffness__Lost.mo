within HystId.Effects;
block LinearStiffness__Lost "Spring of the model that is away for a while"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness that is lost";
equation
  f = -k*x;
  annotation(__HystId_effect(title = "linear spring that is lost"));
end LinearStiffness__Lost;
