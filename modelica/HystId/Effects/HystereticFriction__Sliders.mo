within HystId.Effects;
block HystereticFriction__Sliders "Five sliders behind springs: slip begins in the weakest and spreads"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Full friction force";
  parameter Real x_c(unit="m", min = 0) = 0.0001 "Displacement at which the last of the sliders slips";
  parameter Real ratio(unit="1", min = 0.3, max = 0.95) = 0.6 "Displacement at which a slider slips, relative to the next one";
protected
  parameter Real limit[5](each unit = "m") = {x_c*ratio^(5 - i) for i in 1:5} "Deflection at which each slider slips";
  Boolean slips[5] "The slider follows the motion";
  Real z[5](each unit = "m", each start = 0, each fixed = true) "Deflection of each spring";
equation
  for i in 1:5 loop
    slips[i] = (z[i] >= limit[i] and v > 0) or (z[i] <= -limit[i] and v < 0);
    der(z[i]) = if slips[i] then 0 else v;
  end for;
  f = Fc*sum(z)/sum(limit);
  annotation(Documentation(info = "<html><p>Iwan (1966): springs of equal stiffness, slip displacements in geometric
progression.</p></html>"),
    __HystId_effect(
      becomes = {End(law = "coulomb_friction", of = x_c, below = 1, per = "resolution", fit = "equivalent")}));
end HystereticFriction__Sliders;
