within HystId.Effects;
block AddedMass "Mass that moves with the structure but was not weighed"
  extends HystId.Interfaces.PartialEffect;
  parameter Real dm(unit="kg") = 0 "Mass";
equation
  f = dm*a;
  annotation(Documentation(info = "<html><p>Sensor, cable, stinger or fluid mass.</p></html>"));
end AddedMass;
