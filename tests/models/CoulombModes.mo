model CoulombModes "dry friction with Boolean modes and if-equations"
  parameter Real m = 1, Fc = 2, Fs = 2.5;
  input Real F;
  output Real v(start = 0, fixed = true);
  output Real f;
  Real a;
  Boolean stuck(start = true, fixed = true);
  Boolean forward(start = false, fixed = true);
  Boolean backward(start = false, fixed = true);
equation
  m*a = F - f;
  der(v) = a;
  if stuck then
    a = 0;
  else
    f = if forward then Fc else -Fc;
  end if;
  when stuck and f > Fs then
    forward = true;
    backward = false;
  elsewhen stuck and f < -Fs then
    forward = false;
    backward = true;
  elsewhen not stuck and (pre(forward) and v < 0 or pre(backward) and v > 0) then
    forward = false;
    backward = false;
  end when;
  stuck = not (pre(forward) or pre(backward));
end CoulombModes;
