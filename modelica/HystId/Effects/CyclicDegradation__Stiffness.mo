within HystId.Effects;
block CyclicDegradation__Stiffness "The elastic stiffness weakens with the path travelled"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness that is lost in the end";
  parameter Real path_c(unit="m", min = 0) = 1 "Path over which most of the change happens";
protected
  Real s(unit = "m", start = 0, fixed = true) "Path travelled";
equation
  der(s) = abs(v);
  f = -k*(1 - exp(-s/path_c))*x;
  annotation(Documentation(info = "<html><p>Progressive loss of stiffness with use.</p></html>"),
    __HystId_effect(
      path = path_c));
end CyclicDegradation__Stiffness;
