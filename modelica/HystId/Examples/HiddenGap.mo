within HystId.Examples;
model HiddenGap "A Jenkins oscillator that strikes a stop beyond 1 mm: even harmonics in R"
  extends Oscillators.Jenkins(f_effects = gap.f);
  Effects.ContactLoss gap(x = x, v = v, a = a, h = f_h, k = 2e4, gap = 1e-3) "Contact lost beyond the gap";
  annotation(experiment(StartTime = 0, StopTime = 1, Interval = 1e-4, Tolerance = 1e-6));
end HiddenGap;
