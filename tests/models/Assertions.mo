model Assertions
  parameter Real limit = 0.5;
  input Real u;
  output Real y = 2*u;
equation
  assert(u < limit, "u = " + String(u) + " is not below its limit", AssertionLevel.warning);
  assert(u < 2*limit, "u is far above its limit");
end Assertions;
