within HystId.Effects;
block TwoSidedStop "Two stops: extra stiffness beyond a gap on both sides"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m", min = 0) = 0 "Stiffness added beyond the gap";
  parameter Real gap(unit="m", min = 0) = 0.001 "Displacement at which contact changes";
protected
  Real d(unit = "m") "Displacement beyond the gap, signed";
equation
  d = noEvent(if x > gap then x - gap else if x < -gap then x + gap else 0);
  f = k*d;
  annotation(Documentation(info = "<html><p>Nothing inside the gap, then a kink on both sides: odd harmonics with an onset in amplitude.</p></html>"),
    __HystId_effect(
      title = "contact beyond a gap on both sides",
      family = "contact beyond a gap",
      threshold = gap,
      becomes = {End(law = "contact_loss", of = gap, one_sided = true),
        End(law = "linear_stiffness", of = gap, below = 1, per = "resolution")},
      alike = {Alike(law = "backlash", title = "play between two stops")},
      tells = {Telling(law = "cubic_stiffness", experiment = "record at small and large amplitudes: is there a threshold")},
      experiment = "add a test of larger displacement, so that the stops are reached"));
end TwoSidedStop;
