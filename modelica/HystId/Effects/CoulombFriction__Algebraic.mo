within HystId.Effects;
block CoulombFriction__Algebraic "Dry friction with slow approach to the full force"
  extends HystId.Interfaces.PartialEffect;
  parameter Real Fc(unit="N", min = 0) = 0 "Friction force";
  parameter Real v_s(unit="m/s", min = 0) = 0.001 "Speed over which the friction force changes sign";
equation
  f = Fc*v/sqrt(v^2 + v_s^2);
  annotation(Documentation(info = "<html><p>Other shape of the change of sign.</p></html>"),
    __HystId_effect(
      transition = v_s));
end CoulombFriction__Algebraic;
