package Ctl "causal connectors, a control loop"
  connector RealInput = input Real;
  connector RealOutput = output Real;
  partial block SISO
    RealInput u;
    RealOutput y;
  end SISO;
  block Gain
    extends SISO;
    parameter Real k = 1;
  equation
    y = k*u;
  end Gain;
  block Integrator
    extends SISO;
    parameter Real y0 = 0;
  initial equation
    y = y0;
  equation
    der(y) = u;
  end Integrator;
  block Difference
    RealInput u1;
    RealInput u2;
    RealOutput y;
  equation
    y = u1 - u2;
  end Difference;
  block Step
    RealOutput y;
    parameter Real t0 = 0.1;
  equation
    y = if time < t0 then 0 else 1;
  end Step;
  block Limiter
    extends SISO;
    parameter Real uMax = 1;
    parameter Real uMin = -uMax;
  equation
    y = if u > uMax then uMax elseif u < uMin then uMin else u;
  end Limiter;
  model Loop
    Step step;
    Difference error;
    Gain gain(k = 3);
    Limiter limiter(uMax = 2);
    Integrator plant;
    output Real y = plant.y;
  equation
    connect(step.y, error.u1);
    connect(plant.y, error.u2);
    connect(error.y, gain.u);
    connect(gain.y, limiter.u);
    connect(limiter.y, plant.u);
  end Loop;
end Ctl;
