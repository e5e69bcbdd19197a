model Builtins "elementary functions and rounding"
  Real t = time - 1.3;
  Real a1 = abs(t), a2 = sign(t), a3 = sqrt(t^2 + 1), a4 = exp(-t), a5 = log(2 + t), a6 = log10(2 + t);
  Real b1 = sin(t), b2 = cos(t), b3 = tan(0.3*t), b4 = asin(0.3*t), b5 = acos(0.3*t), b6 = atan(t), b7 = atan2(t, 2);
  Real c1 = sinh(t), c2 = cosh(t), c3 = tanh(t), c4 = max(t, 0.5), c5 = min({t, 0.5, -0.2});
  Real d1 = mod(t, 0.7), d2 = rem(t, 0.7), d3 = floor(t/0.3), d4 = ceil(t/0.3), d5 = div(t, 0.4);
  Integer k = integer(3*t);
  Real e1 = semiLinear(t, 2, 3), e2 = smooth(1, if t > 0 then t^2 else -t^2), e3 = noEvent(if t > 0 then 1 else -1);
  Real e4 = 2^3*4 - 6/2/3, e5 = -t^2, e6 = (-t)^3;
end Builtins;
