model ThermostatPre "the same by a Boolean equation with pre"
  parameter Real T_low = 18;
  parameter Real T_high = 22;
  output Real T(start = 15, fixed = true);
  output Boolean on(start = true, fixed = true);
equation
  der(T) = (if on then 10 else 0) - 0.2*(T - 5);
  on = T <= T_low or pre(on) and T < T_high;
end ThermostatPre;
