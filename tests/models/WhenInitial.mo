model WhenInitial "initial() in when, change and edge of Boolean variables, if inside when, vector conditions"
  discrete output Real count(start = 5, fixed = true);
  output Real y(start = 0, fixed = true);
  Boolean up = sin(10*time) > 0;
  Boolean late = time > 0.5;
  discrete output Real edges(start = 0, fixed = true);
  Integer last(start = 0, fixed = true);
equation
  der(y) = 1;
  when {initial(), change(up)} then
    count = pre(count) + 1;
  end when;
  when {edge(up), edge(late)} then
    edges = pre(edges) + 1;
    if late then
      last = 2;
    else
      last = 1;
    end if;
  end when;
end WhenInitial;
