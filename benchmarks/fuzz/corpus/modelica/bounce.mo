model BouncingBall "reinit, edge of a relation"
  parameter Real g(unit = "m/s2") = 9.81 "Gravity";
  parameter Real e = 0.8 "Restitution";
  output Real h(unit = "m", start = 1, fixed = true) "Height";
  output Real v(unit = "m/s", start = 0, fixed = true) "Velocity, positive upwards";
  output Integer bounces(start = 0, fixed = true) "Number of impacts";
equation
  der(h) = v;
  der(v) = -g;
  when h < 0 then
    reinit(v, -e*pre(v));
    bounces = pre(bounces) + 1;
  end when;
  annotation(experiment(StartTime = 0, StopTime = 1.2, Interval = 1e-3, Tolerance = 1e-6));
end BouncingBall;
