within HystId.Examples;
model LabRig "Virtual test rig: a stick-slip joint whose contact opens on one side"
  extends Oscillators.Jenkins(m = 1, B = 10, Kl = 1e4, Ks = 5e4, fc = 37.5, f_effects = -share*open*f_h);
  parameter Units.Dimensionless share(min = 0, max = 1) = 0.9 "Share of the friction that is lost where the contact is open";
  parameter Units.Displacement gap(min = 0) = 1.2e-3 "Displacement beyond which the contact opens";
  parameter Units.Displacement width(min = 0) = 1e-4 "Displacement over which it opens";
  Units.Dimensionless open "Share of the contact that is open";
equation
  open = 0.5*(1 + (x - gap)/sqrt((x - gap)^2 + width^2));
  annotation(
    experiment(StopTime = 5, Interval = 1e-4),
    Documentation(info = "<html><p>The rig of the virtual experiments. To an observer who believes in a stick-slip joint it shows even
harmonics that such a joint cannot give: beyond the gap the surfaces lift off and the friction is lost. The diagnosis does not
know this model; it is recorded, and what it conceals has to be found.</p></html>"));
end LabRig;
