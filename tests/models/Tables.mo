model Tables "table by if-expressions, trigger by conditional component"
  parameter Boolean withOffset = true;
  parameter Integer mode = 2;
  Real u = 3*sin(time);
  output Real y = if u < -1 then -2 elseif u < 0 then 2*u elseif u < 1 then u else 1;
  Real offset if withOffset;
  output Real z;
equation
  if mode == 1 then
    z = u;
  elseif mode == 2 then
    z = u + 10;
  else
    z = 0;
  end if;
  if withOffset then
    offset = 1;
  end if;
end Tables;
