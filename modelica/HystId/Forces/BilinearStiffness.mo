within HystId.Forces;
block BilinearStiffness "Breathing crack: stiffer while closed (x < 0) than while open"
  extends Interfaces.PartialForce;
  parameter Units.Stiffness k_open(min = 0) = 8e3 "Stiffness for x > 0";
  parameter Units.Stiffness k_closed(min = 0) = 1e4 "Stiffness for x < 0";
equation
  f = noEvent(if x > 0 then k_open*x else k_closed*x);
end BilinearStiffness;
