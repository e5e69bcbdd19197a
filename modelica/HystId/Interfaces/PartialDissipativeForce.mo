within HystId.Interfaces;
partial block PartialDissipativeForce "Restoring-force law that turns work into heat"
  extends PartialForce;
  output Units.Power loss "Power turned into heat, not negative";
end PartialDissipativeForce;
