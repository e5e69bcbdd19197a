package Sizes "parameters that decide sizes, loops, subscripts and equations"
  model Element
    parameter Real k = 1;
    Real y = k*time;
  end Element;
  function power
    input Integer n;
    output Real y;
  algorithm
    y := 0;
    for i in 1:n loop
      y := y + i;
    end for;
  end power;
  model M
    parameter Integer components = 2;
    parameter Integer chosen = 2;
    parameter Integer terms = 3;
    parameter Integer factor = 3;
    Element element[components];
    Real table[3] = {10, 20, 30};
    Real y = table[chosen];
    Real z = power(terms)*time;
    Real w = factor*time;
  end M;
end Sizes;
