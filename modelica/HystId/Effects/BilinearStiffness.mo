within HystId.Effects;
block BilinearStiffness "Breathing crack: extra stiffness on one side of x = 0"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m") = 0 "Stiffness at positive x minus stiffness at negative x";
equation
  f = k*noEvent(if x > 0 then x else 0);
  annotation(Documentation(info = "<html><p>Even harmonics in a ratio that does not depend on the amplitude.</p></html>"),
    __HystId_effect(
      title = "bilinear stiffness",
      family = "nonlinear spring",
      experiment = "push and pull from the middle by the same amounts"));
end BilinearStiffness;
