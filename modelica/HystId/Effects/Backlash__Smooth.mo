within HystId.Effects;
block Backlash__Smooth "Free play with rounded corners"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness that is missing inside the gap";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
equation
  f = -k*gap*tanh(x/gap);
  annotation(Documentation(info = "<html><p>Clearance filled with grease or rough surfaces.</p></html>"),
    __HystId_effect(
      threshold = gap));
end Backlash__Smooth;
