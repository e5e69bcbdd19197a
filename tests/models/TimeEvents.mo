model TimeEvents "relations of time and sample, located exactly"
  parameter Real T = 0.333;
  output Real y;
  output Real x(start = 0, fixed = true);
  output Integer n(start = 0, fixed = true);
  discrete output Real held(start = -1, fixed = true);
equation
  y = if time < T then 1 elseif time < 2*T then -2 else 0.5;
  der(x) = y;
  when sample(0.1, 0.25) then
    n = pre(n) + 1;
    held = x;
  end when;
end TimeEvents;
