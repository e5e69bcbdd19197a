within HystId.Effects;
block Pinching__Slip "The hysteretic force is reduced after each change of its sign, until a slip is used up"
  extends HystId.Interfaces.PartialEffect;
  parameter Real share(unit="1", min = 0, max = 1) = 0 "Share of the hysteretic force that is missing where the slip begins";
  parameter Real width(unit="1", min = 0.02, max = 0.7) = 0.2 "Slip over the largest stroke so far, from peak to peak";
protected
  Real reach(unit = "m") "Largest displacement so far, either way";
  Real pulled(unit = "m", start = 0, fixed = true) "Slip since the force became positive";
  Real pushed(unit = "m", start = 0, fixed = true) "Slip since the force became negative";
initial equation
  reach = abs(x);
equation
  der(reach) = noEvent(if abs(x) > reach and x*v > 0 then 2*abs(v) else 0);
  der(pulled) = noEvent(if h <= 0 then -pulled*abs(v)/(0.3*reach + 1e-9) else if v > 0 then v else 0);
  der(pushed) = noEvent(if h >= 0 then -pushed*abs(v)/(0.3*reach + 1e-9) else if v < 0 then -v else 0);
  f = -share*h*exp(-(noEvent(if h > 0 then pulled else pushed)/(width*(2*reach + 1e-9)))^2);
  annotation(Documentation(info = "<html><p>Cracks that the last half cycle opened close before the section bears again (slip and lock after Baber and Noori, 1985; Foliente, 1995).
Unloading follows the full force. The slip of one direction is forgotten while the force acts in the other.</p></html>"));
end Pinching__Slip;
