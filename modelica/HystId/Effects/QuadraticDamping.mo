within HystId.Effects;
block QuadraticDamping "Drag proportional to the square of the speed"
  extends HystId.Interfaces.PartialEffect;
  parameter Real c(unit="N.s2/m2", min = 0) = 0 "Drag coefficient";
equation
  f = c*v*abs(v);
  annotation(Documentation(info = "<html><p>Turbulent fluid or orifice damping.</p></html>"));
end QuadraticDamping;
