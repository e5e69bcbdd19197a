within HystId.Effects;
block ContactLoss__Friction "The frictional contact of the baseline opens beyond a gap on one side"
  extends HystId.Interfaces.PartialEffect;
  parameter Real share(unit="1") = 0 "Share of the hysteretic force that is lost where the contact is open";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
  parameter Real w(unit="m", min = 0) = 0.0001 "Displacement over which the contact opens";
  parameter Integer side(min = -1, max = 1) = 1 "1: acts at large positive x, -1: at large negative x";
equation
  f = -share*h*0.5*(1 + tanh((side*x - gap)/w));
  annotation(Documentation(info = "<html><p>The hysteretic force of the baseline vanishes where the surfaces separate.</p></html>"),
    __HystId_effect(
      threshold = gap,
      width = w,
      switch = side));
end ContactLoss__Friction;
