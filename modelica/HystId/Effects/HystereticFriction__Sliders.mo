within HystId.Effects;
block HystereticFriction__Sliders "Five sliders behind springs: slip begins in the weakest and spreads"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Full friction force";
  parameter Real x_c(unit="m", min = 0) = 0.0001 "Displacement at which the last of the sliders slips";
  parameter Real ratio(unit="1", min = 0.3, max = 0.95) = 0.6 "Displacement at which a slider slips, relative to the next one";
protected
  Real w[5](each unit = "1", each start = 0, each fixed = true) "Force of each slider relative to its full value";
  Real length[5](each unit = "m") "Displacement at which each slider slips";
equation
  length = {x_c*ratio^(5 - i) for i in 1:5};
  for i in 1:5 loop
    der(w[i]) = noEvent(if w[i] > 1 and v > 0 then v/length[i]*(1 - w[i])*2 else if w[i] < -1 and v < 0 then -v/length[i]*(-1 - w[i])*2 else v/length[i]);
  end for;
  f = Fc*(length*w)/sum(length);
  annotation(Documentation(info = "<html><p>Iwan (1966): springs of equal stiffness, slip displacements in geometric
progression, with corners that a solver can follow.</p></html>"));
end HystereticFriction__Sliders;
