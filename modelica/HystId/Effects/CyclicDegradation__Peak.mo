within HystId.Effects;
block CyclicDegradation__Peak "The hysteretic force weakens with the largest displacement so far"
  extends HystId.Interfaces.PartialEffect;
  parameter Real share(unit="1", min = 0, max = 1) = 0 "Share of the hysteretic force that is lost in the end";
  parameter Real x_d(unit="m", min = 0) = 0.001 "Displacement within which most of the change happens";
protected
  Real reach(unit = "m") "Largest displacement so far, either way";
initial equation
  reach = abs(x);
equation
  der(reach) = noEvent(if abs(x) > reach and x*v > 0 then 2*abs(v) else 0);
  f = -share*(1 - exp(-reach/x_d))*h;
  annotation(Documentation(info = "<html><p>Cracking and yielding: damage follows the largest deformation, repeated cycles of one size add none.
The factor 2 lets the memory catch up where it lags behind the motion.</p></html>"));
end CyclicDegradation__Peak;
