within HystId.Effects;
block AddedMass "Mass that moves with the structure but was not weighed"
  extends HystId.Interfaces.PartialEffect;
  parameter Real dm(unit="kg") = 0 "Mass";
equation
  f = dm*a;
  annotation(Documentation(info = "<html><p>Sensor, cable, stinger or fluid mass.</p></html>"),
    __HystId_effect(
      title = "added mass",
      mass = dm,
      needs = {"speeds"},
      becomes = {End(law = "force_gain", of = dm, below = 0, fit = "renamed")},
      alike = {Alike(law = "force_gain", title = "mass or force scale that is off")},
      tells = {Telling(law = "force_gain", steered = false,
        experiment = "calibrate the force channel with a known weight, or weigh the moving parts")},
      experiment = "test fast enough that inertia is a good part of the force"));
end AddedMass;
