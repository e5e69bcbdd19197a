within HystId.Effects;
block QuadraticDamping__Cubic "Drag that grows with the square and the cube of the speed"
  extends HystId.Interfaces.PartialEffect;
  parameter Real c(unit="N.s2/m2", min = 0) = 0 "Drag coefficient";
  parameter Real c3(unit="N.s3/m3") = 0 "Cubic drag coefficient";
equation
  f = c*v*abs(v) + c3*v^3;
  annotation(Documentation(info = "<html><p>For orifices whose exponent differs from two.</p></html>"),
    __HystId_effect(
      becomes = {End(law = "", of = c3, below = 0, over = c)}));
end QuadraticDamping__Cubic;
