package Conditions "parameters that decide components"
  type Law = enumeration(linear, cubic);
  model Integrator
    parameter Real rate = 1;
    Real y(start = 0, fixed = true);
  equation
    der(y) = rate;
  end Integrator;
  model Line "as many integrators as said, in front of a further one"
    parameter Integer count = 2;
    parameter Real slope = 1;
    Integrator parts[count](each rate = slope);
    Real total = sum(parts.y);
  end Line;
  model Rig
    parameter Boolean wanted = false;
    parameter Real ratio = 2;
    parameter Law law = Law.linear;
    parameter Real slope = 1 "decides nothing";
    Line line(slope = slope) if wanted;
    Integrator cubed(rate = 3) if law == Law.cubic;
    Integrator other if ratio > 3;
    Integrator many[2](each rate = slope);
    Real z(start = 1, fixed = true);
  equation
    der(z) = -z;
  end Rig;
end Conditions;
