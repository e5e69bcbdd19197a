within HystId.Effects;
block ViscousDamping__Lost "Damper of the model that is away for a while"
  extends HystId.Interfaces.PartialEffect;
  parameter Real c(unit="N.s/m", min = 0) = 0 "Damping coefficient that is lost";
equation
  f = -c*v;
  annotation(__HystId_effect(title = "viscous damper that is lost"));
end ViscousDamping__Lost;
