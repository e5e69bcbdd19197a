model Arrays "vectors, matrices, comprehensions, for-equations"
  parameter Integer n = 4;
  parameter Real A[2, 2] = [-1, 2; -3, -0.5];
  parameter Real b[2] = {1, 0.5};
  parameter Real w[n] = {1/i for i in 1:n};
  Real x[2](start = {1, 2}, each fixed = true);
  Real y[n];
  Real total, dot, row, last, matrix[2, n], cross3[3], quad;
equation
  der(x) = A*x + b*sin(time);
  for i in 1:n loop
    y[i] = w[i]*x[1] + i;
  end for;
  total = sum(y) + product(w);
  dot = x*b;
  row = A[1, :]*x;
  last = y[end];
  matrix = transpose([y, 2*y]);
  cross3 = cross({x[1], x[2], 1.0}, {1.0, 2.0, 3.0});
  quad = x*A*x + sum(k*x[k] for k in 1:2) + max(w) + size(A, 2);
end Arrays;
