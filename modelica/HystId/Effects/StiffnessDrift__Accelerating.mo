within HystId.Effects;
block StiffnessDrift__Accelerating "The elastic stiffness changes with time, faster or slower as it goes on"
  extends HystId.Interfaces.PartialEffect;
  parameter Real rate(unit="N/(m.s)") = 0 "Change of stiffness per time at the start";
  parameter Real bend(unit="N/(m.s2)") = 0 "Half the change of that rate per time";
equation
  f = (rate + bend*time)*time*x;
  annotation(Documentation(info = "<html><p>Wear or heating that feeds itself, to the second order in time.</p></html>"));
end StiffnessDrift__Accelerating;
