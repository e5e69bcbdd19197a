package Enumerations
  type Mode = enumeration(idle "waiting", run "moving", done);
  model Machine
    Mode mode(start = Mode.idle, fixed = true);
    output Real x(start = 0, fixed = true);
  equation
    der(x) = if mode == Mode.run then 2 else 0;
    when time >= 0.2 then
      mode = Mode.run;
    elsewhen x >= 1 then
      mode = Mode.done;
    end when;
  end Machine;
end Enumerations;
