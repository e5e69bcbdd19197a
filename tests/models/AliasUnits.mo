package AliasUnits "type aliases with attributes, short classes, imports"
  type Length = Real(final quantity = "Length", final unit = "m");
  package Constants
    constant Real two = 2;
    constant Real four = two*two;
  end Constants;
  model M
    import C = AliasUnits.Constants;
    import AliasUnits.Constants.two;
    input Length x(min = -1, max = 1, nominal = 1e-3);
    output Length y = C.four*x + two*x;
  end M;
end AliasUnits;
