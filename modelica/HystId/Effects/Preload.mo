within HystId.Effects;
block Preload "Constant force"
  extends HystId.Interfaces.PartialEffect;
  parameter Real f0(unit="N") = 0 "Force";
equation
  f = f0;
  annotation(Documentation(info = "<html><p>Weight, magnet or clamping force that the baseline does not have.</p></html>"));
end Preload;
