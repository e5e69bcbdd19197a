within HystId.Examples;
model LawComparison "Several laws under one motion of growing amplitude"
  parameter Units.Displacement amplitude = 4e-3 "Amplitude after one second";
  parameter Real frequency(unit = "Hz") = 5 "Frequency of the motion";
  Forces.Jenkins jenkins "Stick, then slip";
  Forces.Iwan iwan "Slip that spreads";
  Forces.Dahl dahl "Stiffness that fades";
  Forces.MicroSlip microSlip "Slip that begins at once";
  Forces.BoucWen boucWen(beta = 1334, gamma = 0.5, delta = 0.5) "Smooth loops, with the same limit";
  Units.Displacement x "Motion of all";
  Units.Velocity v "Its rate";
protected
  constant Real pi = 3.141592653589793;
  Real w(unit = "1/s") = 2*pi*frequency "Angular frequency";
  Real growth(unit = "1/s") = 1 "The amplitude grows by itself in this time";
equation
  x = amplitude*growth*time*sin(w*time);
  v = amplitude*growth*(sin(w*time) + w*time*cos(w*time));
  jenkins.x = x;
  jenkins.v = v;
  iwan.x = x;
  iwan.v = v;
  dahl.x = x;
  dahl.v = v;
  microSlip.x = x;
  microSlip.v = v;
  boucWen.x = x;
  boucWen.v = v;
  annotation(experiment(StartTime = 0, StopTime = 1, Interval = 1e-4, Tolerance = 1e-6));
end LawComparison;
