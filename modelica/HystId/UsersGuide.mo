within HystId;
package UsersGuide "How this library counts signs, and how to add to it"
  class SignConventions "Signs and units"
    annotation(Documentation(info = "<html>
<p>m a + R = F, with R = B v + Kl x + f_h + f_effects. The excitation F counts in the direction of x. The restoring force R
and each of its parts opposes motion as a spring does: it is positive where x is positive. v = dx/dt, a = dv/dt.
All variables are in SI units. <code>loss</code> is power turned into heat, positive.</p>
</html>"));
  end SignConventions;

  class HowToAddALaw "A new restoring-force law is a new file"
    annotation(Documentation(info = "<html>
<p>Extend <code>Interfaces.PartialForce</code>, or <code>Interfaces.PartialDissipativeForce</code> where energy is lost: the
inputs x and v and the output f are there, parameters and equations are yours. Give every declaration a text that states
its sign, and every parameter a unit. Inner states start from their own start values with fixed = true.
Where the law switches, prefer branches that meet (a continuous f): events are then located and keep the accuracy of the
integration. Write noEvent() where a branch is no more than a formula.</p>
<p>An oscillator with the law extends <code>Interfaces.PartialOscillator</code>, repeats the law's parameters, and sets
<code>law.x = x; law.v = v; f_h = law.f</code>; see <code>Oscillators.Jenkins</code>.</p>
</html>"));
  end HowToAddALaw;

  class HowToAddAnEffect "A new effect is a new file"
    annotation(Documentation(info = "<html>
<p>Extend <code>Interfaces.PartialEffect</code>: inputs x, v, a, the hysteretic force h of the baseline; output f, which is
added to R. With all amplitudes at 0 the effect must vanish. Add it to an oscillator so:</p>
<pre>model Rig
  extends HystId.Oscillators.Jenkins(f_effects = gap.f);
  HystId.Effects.ContactLoss gap(x = x, v = v, a = a, h = f_h);
end Rig;</pre>
</html>"));
  end HowToAddAnEffect;
  annotation(Documentation(info = "<html>
<p>HystId holds oscillators of one mass with hysteretic restoring forces, the laws of these forces, and effects that such
laws leave out. It stands alone: no other library has to be loaded, and nothing in it belongs to one tool.</p>
</html>"));
end UsersGuide;
