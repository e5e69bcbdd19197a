model Thermostat "hysteresis with when and elsewhen"
  parameter Real T_low = 18;
  parameter Real T_high = 22;
  output Real T(start = 15, fixed = true);
  output Boolean on(start = true, fixed = true);
  output Integer switches(start = 0, fixed = true);
equation
  der(T) = (if on then 10 else 0) - 0.2*(T - 5);
  when T >= T_high then
    on = false;
    switches = pre(switches) + 1;
  elsewhen T <= T_low then
    on = true;
    switches = pre(switches) + 1;
  end when;
end Thermostat;
