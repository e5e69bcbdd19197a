within HystId.Effects;
block ViscousDamping__Lost "Damper of the model that is away for a while"
  extends HystId.Interfaces.PartialEffect;
  parameter Real c(unit="N.s/m", min = 0) = 0 "Damping coefficient that is lost";
equation
  f = -c*v;
end ViscousDamping__Lost;
