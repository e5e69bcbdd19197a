model Heat "slices of arrays"
  parameter Integer N = 6;
  parameter Real L = 1, k = 0.1;
  parameter Real dx = L/N;
  Real T[N](each start = 20, each fixed = true);
equation
  der(T[1]) = k*(100 - 2*T[1] + T[2])/dx^2;
  der(T[2:N - 1]) = k*(T[1:N - 2] - 2*T[2:N - 1] + T[3:N])/dx^2;
  der(T[N]) = k*(T[N - 1] - T[N])/dx^2;
end Heat;
