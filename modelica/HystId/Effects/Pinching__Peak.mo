within HystId.Effects;
block Pinching__Peak "The hysteretic force is reduced around the middle, the wider the further the motion has been"
  extends HystId.Interfaces.PartialEffect;
  parameter Real share(unit="1", min = 0, max = 1) = 0 "Share of the hysteretic force that is missing at x = 0";
  parameter Real width(unit="1", min = 0.05, max = 1) = 0.4 "Half width of the pinched region over the largest displacement so far";
protected
  Real up(unit = "m") "Largest displacement so far";
  Real down(unit = "m") "Largest displacement so far to the other side";
  Real reach(unit = "m") "The one of the side where the motion is";
initial equation
  up = max(x, 0);
  down = max(-x, 0);
equation
  der(up) = noEvent(if x > up and v > 0 then 2*v else 0);
  der(down) = noEvent(if -x > down and v < 0 then -2*v else 0);
  reach = noEvent(if x > 0 then up else down);
  f = -share*h*exp(-(x/(width*(reach + 1e-9)))^2);
  annotation(Documentation(info = "<html><p>Cracks and holes that were opened further have further to close: reinforced concrete, nailed and bolted joints.
Each side remembers its own largest displacement (Lowes and Altoontash, 2003). The factor 2 lets the memory catch up where it lags behind the motion.</p></html>"));
end Pinching__Peak;
