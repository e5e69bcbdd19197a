package HystIdTest "Models that check HystId, and the signals to compare between tools (comparisonSignals.txt)"
  annotation(Documentation(info = "<html><p>comparisonSignals.txt names, for every model, the continuous signals of a
simulation that must agree between tools. Modes are not compared: they may differ at single instants.</p></html>"));
end HystIdTest;
