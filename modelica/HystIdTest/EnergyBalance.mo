within HystIdTest;
model EnergyBalance "What the motion brings into a Jenkins element is stored or lost"
  HystId.Forces.Jenkins element "Element under a given motion";
  HystId.Units.Displacement x "Motion";
  HystId.Units.Velocity v(start = 0, fixed = true) "Rate of the motion";
  Real work(unit = "J", start = 0, fixed = true) "Work done on the element";
  Real heat(unit = "J", start = 0, fixed = true) "Heat made in it";
  Real balance(unit = "J") "Work less heat less stored energy: zero";
protected
  constant Real pi = 3.141592653589793;
equation
  x = 2e-3*(1 - cos(2*pi*5*time));
  der(v) = 2e-3*(2*pi*5)^2*cos(2*pi*5*time);
  element.x = x;
  element.v = v;
  der(work) = element.f*v;
  der(heat) = element.loss;
  balance = work - heat - element.f^2/(2*element.Ks);
  annotation(experiment(StartTime = 0, StopTime = 1, Interval = 1e-4, Tolerance = 1e-8));
end EnergyBalance;
