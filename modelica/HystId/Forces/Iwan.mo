within HystId.Forces;
block Iwan "N Jenkins elements in parallel: slip starts in the weakest and spreads"
  extends Interfaces.PartialDissipativeForce;
  parameter Integer N(min = 1) = 8 "Number of elements";
  parameter Units.Stiffness Ks(min = 0) = 5e4 "Stiffness while all elements stick";
  parameter Units.Force fc(min = 0) = 37.5 "Force at which all elements slip";
protected
  Jenkins element[N](each Ks = Ks/N, fc = {2*fc*i/(N*(N + 1)) for i in 1:N}) "Equal stiffness, slip force grows linearly";
equation
  for i in 1:N loop
    element[i].x = x;
    element[i].v = v;
  end for;
  f = sum(element[i].f for i in 1:N);
  loss = sum(element[i].loss for i in 1:N);
  annotation(Documentation(info = "<html><p>Iwan (1966), parallel-series model with N elements.</p></html>"));
end Iwan;
