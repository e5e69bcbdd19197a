"""External functions of which rumoca 0.10 refuses the arguments: it takes inputs and outputs alone, no local variables.

What solves linear equations in LAPACK (dgesv, dgetrf, dgetrs, dgetri) is written in Modelica instead, so that
``Modelica.Math.Matrices.solve`` and its like work where sizes are known: elimination with the largest pivot of each
column, as LAPACK does it. Other external functions are read with their inputs and outputs as arguments, and are refused
where they are called.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence

from hystid.modelica.clauses import Clause, clauses, closing, next_mark, parted
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_EXTERNAL = re.compile(r"(?<![\w.])external\b\s*(?:(?P<out>[A-Za-z_]\w*)\s*=\s*)?(?P<name>[A-Za-z_]\w*)\s*\(")
_LOCALS = "protected Integer hystid_p, hystid_n; Real hystid_big, hystid_t; "
# Ranges begin and end at what the front end knows without the value of a loop's index; what lies outside stays.
_FACTORS = """{info} := 0;
for hystid_k in 1:min(size({a}, 1), size({a}, 2)) loop
  hystid_p := hystid_k;
  hystid_big := abs({a}[hystid_k, hystid_k]);
  for hystid_i in 1:size({a}, 1) loop
    hystid_t := if hystid_i > hystid_k then abs({a}[hystid_i, hystid_k]) else 0;
    hystid_p := if hystid_t > hystid_big then hystid_i else hystid_p;
    hystid_big := if hystid_t > hystid_big then hystid_t else hystid_big;
  end for;
  for hystid_i in 1:size({a}, 1) loop
    for hystid_j in 1:size({a}, 2) loop
      hystid_t := {a}[hystid_k, hystid_j];
      {a}[hystid_k, hystid_j] := if hystid_i > hystid_k and hystid_p == hystid_i then {a}[hystid_i, hystid_j]
        else hystid_t;
      {a}[hystid_i, hystid_j] := if hystid_i > hystid_k and hystid_p == hystid_i then hystid_t
        else {a}[hystid_i, hystid_j];
    end for;
  end for;
  {info} := if {info} == 0 and not hystid_big > 0 then hystid_k else {info};
  for hystid_i in 1:size({a}, 1) loop
    {a}[hystid_i, hystid_k] := if hystid_i > hystid_k then
      (if hystid_big > 0 then {a}[hystid_i, hystid_k]/{a}[hystid_k, hystid_k] else 0) else {a}[hystid_i, hystid_k];
    for hystid_j in 1:size({a}, 2) loop
      {a}[hystid_i, hystid_j] := if hystid_i > hystid_k and hystid_j > hystid_k then
        {a}[hystid_i, hystid_j] - {a}[hystid_i, hystid_k]*{a}[hystid_k, hystid_j] else {a}[hystid_i, hystid_j];
    end for;
  end for;
  {pivots}[hystid_k] := hystid_p;
end for; """
_SOLUTION = """for hystid_k in 1:size({a}, 1) loop
  for hystid_i in 1:size({a}, 1) loop
    hystid_t := {x}[hystid_k{c}];
    {x}[hystid_k{c}] := if hystid_i > hystid_k and {pivots}[hystid_k] == hystid_i then {x}[hystid_i{c}] else hystid_t;
    {x}[hystid_i{c}] := if hystid_i > hystid_k and {pivots}[hystid_k] == hystid_i then hystid_t else {x}[hystid_i{c}];
  end for;
end for;
for hystid_i in 1:size({a}, 1) loop
  for hystid_j in 1:size({a}, 1) loop
    {x}[hystid_i{c}] := if hystid_j < hystid_i then
      {x}[hystid_i{c}] - {a}[hystid_i, hystid_j]*{x}[hystid_j{c}] else {x}[hystid_i{c}];
  end for;
end for;
for hystid_r in 1:size({a}, 1) loop
  hystid_n := size({a}, 1) + 1 - hystid_r;
  for hystid_j in 1:size({a}, 1) loop
    {x}[hystid_n{c}] := if hystid_j > hystid_n then
      {x}[hystid_n{c}] - {a}[hystid_n, hystid_j]*{x}[hystid_j{c}] else {x}[hystid_n{c}];
  end for;
  {x}[hystid_n{c}] := {x}[hystid_n{c}]/{a}[hystid_n, hystid_n];
end for; """


def with_plain_externals(source: Source) -> Source:
    """The text with such functions rewritten; lines stay where they are."""
    if not re.search(r"\bexternal\b", source.plain):
        return source
    functions = [c for c in classes(source) or () if c.kind == "function"]
    return edited(source, (edit for owner in functions for edit in _rewritten(owner)))


def _rewritten(owner: Class) -> Iterator[Edit]:
    plain, text = owner.source.plain, owner.source.text
    found = _EXTERNAL.search(plain, owner.body, owner.tail)
    declared = {c.name: c for c in clauses(owner) if c.kind == "component"}
    if found is None or owner.name in ("constructor", "destructor"):
        return
    end = closing(plain, found.end() - 1)
    names = [text[start:stop].strip() for start, stop in parted(plain, found.end(), end)]
    local = {n for n, c in declared.items() if not {"input", "output", "parameter", "constant"} & set(c.prefixes)}
    if not local & {*names, found["out"] or ""}:
        return
    stop = next_mark(plain, end, owner.tail, ";") + 1
    lines = "\n" * plain.count("\n", found.start(), stop)
    written = _ROUTINES.get(found["name"].lower())
    made = written(names, declared) if written else ""
    if made:
        yield found.start(), stop, re.sub(r"\s+", " ", made) + lines
        return
    known = [n for n, c in declared.items() if {"input", "output"} & set(c.prefixes)]
    yield found.start(), stop, f'external "C" {found["name"]}({", ".join(known)});{lines}'


def _columns(name: str, declared: dict[str, Clause]) -> bool:
    """Whether an argument is a matrix of right hand sides."""
    sizes = ", ".join(declared[name].sizes)
    return next_mark(sizes, 0, len(sizes), ",") < len(sizes)


def _solution(a: str, pivots: str, x: str, columns: bool) -> str:
    if not columns:
        return _SOLUTION.format(a=a, pivots=pivots, x=x, c="")
    inner = _SOLUTION.format(a=a, pivots=pivots, x=x, c=", hystid_c")
    return f"for hystid_c in 1:size({x}, 2) loop {inner} end for; "


def _gesv(names: Sequence[str], declared: dict[str, Clause]) -> str:
    _, _, a, _, pivots, x, _, info = names
    steps = _FACTORS.format(a=a, pivots=pivots, info=info) + _solution(a, pivots, x, _columns(x, declared))
    return f"{_LOCALS}algorithm {steps}"


def _getrf(names: Sequence[str], declared: dict[str, Clause]) -> str:
    _, _, a, _, pivots, info = names
    return f"{_LOCALS}algorithm {_FACTORS.format(a=a, pivots=pivots, info=info)}"


def _getrs(names: Sequence[str], declared: dict[str, Clause]) -> str:
    way, _, _, a, _, pivots, x, _, info = names
    if way != '"N"':
        return ""
    return f"{_LOCALS}algorithm {info} := 0; {_solution(a, pivots, x, _columns(x, declared))}"


def _getri(names: Sequence[str], declared: dict[str, Clause]) -> str:
    _, a, _, pivots, *_, info = names
    made = f"{_LOCALS}Real hystid_x[size({a}, 1), size({a}, 1)] = identity(size({a}, 1)); algorithm "
    return f"{made}{info} := 0; {_solution(a, pivots, 'hystid_x', True)}{a} := hystid_x; "


_ROUTINES: dict[str, Callable[[Sequence[str], dict[str, Clause]], str]] = {
    "dgesv": _gesv,
    "dgetrf": _getrf,
    "dgetrs": _getrs,
    "dgetri": _getri,
}
