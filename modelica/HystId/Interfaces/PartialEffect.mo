within HystId.Interfaces;
partial block PartialEffect "Physics that a baseline may have left out: f is added to the restoring force R"
  input Units.Displacement x "Displacement";
  input Units.Velocity v "Velocity";
  input Units.Acceleration a "Acceleration";
  input Units.Force h "Hysteretic force of the baseline";
  output Units.Force f "Force of the effect, counted as the restoring force is";
end PartialEffect;
