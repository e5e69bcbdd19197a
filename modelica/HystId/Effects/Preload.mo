within HystId.Effects;
block Preload "Constant force"
  extends HystId.Interfaces.PartialEffect;
  parameter Real f0(unit="N") = 0 "Force";
equation
  f = f0;
  annotation(Documentation(info = "<html><p>Weight, magnet or clamping force that the baseline does not have.</p></html>"),
    __HystId_effect(
      title = "constant force",
      alike = {Alike(law = "force_drift", provided = "constant", title = "constant force or force zero that is off")},
      tells = {Telling(law = "force_drift", steered = false,
        experiment = "record the force channel with nothing attached, before and after a test")},
      experiment = "record a stretch at rest",
      steered = false));
end Preload;
