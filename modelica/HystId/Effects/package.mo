within HystId;
package Effects "Physics that a baseline may have left out: one block each; f is added to the restoring force R"
  annotation(Documentation(info = "<html>
<p>Each block has the inputs x, v, a (motion), h (hysteretic force of the baseline) and the output f.
The name of a block in snake case is the id of the effect; what follows a double underscore names a form of the same effect.</p>
<p>What cannot be computed from the equations, a block declares in an annotation __HystId_effect (users' guide); all of it
is optional. A parameter in which f is linear is an amplitude. Of the others it takes the range from the
unit (m: displacements of the recording, or the path travelled where the block declares a path; m/s: speeds;
s and Hz: time scales; N and J: forces and energies) or, for
unit 1, from min and max. The first shape is searched in fine steps, so put the
threshold first. An Integer parameter is tried at each value between min and max.</p>
</html>"));
end Effects;
