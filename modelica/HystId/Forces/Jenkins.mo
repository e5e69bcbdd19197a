within HystId.Forces;
block Jenkins "Spring in series with a dry slider (elastic-perfectly plastic), valid at every amplitude"
  extends Interfaces.PartialDissipativeForce;
  parameter Units.Stiffness Ks(min = 0) = 5e4 "Stiffness while the slider sticks";
  parameter Units.Force fc(min = 0) = 37.5 "Force at which the slider slips";
protected
  Boolean slips "The slider follows the motion";
  Units.Force z(start = 0, fixed = true) "Force in the spring";
equation
  slips = (z >= fc and v > 0) or (z <= -fc and v < 0);
  der(z) = if slips then 0 else Ks*v;
  f = z;
  loss = if slips then z*v else 0;
  annotation(Documentation(info = "<html><p>Jenkins (1962). Sticking is elastic, so the change between stick and slip is a pair of
events per half cycle and never chatters; the turning-point memory is the spring force itself.</p></html>"));
end Jenkins;
