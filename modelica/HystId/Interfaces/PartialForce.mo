within HystId.Interfaces;
partial block PartialForce "Restoring-force law: f opposes motion as a spring does, f > 0 for x > 0"
  input Units.Displacement x "Displacement";
  input Units.Velocity v "Velocity, v = der(x)";
  output Units.Force f "Restoring force, to be overcome by the excitation";
end PartialForce;
