"""The front end's flat dictionary read into ``FlatModel``; what the subset leaves out is refused by name and line."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import replace
from typing import Any

from hystid.modelcode import BuiltInText, Enumeration
from hystid.modelica.diagnostics import REFUSED
from hystid.modelica.dictionary import DictionaryReader
from hystid.modelica.expr import ONE, ZERO, Expr, Num, Op, Ref, Text
from hystid.modelica.flat import (
    Action,
    Assertion,
    Branch,
    Equation,
    FlatModel,
    FlatVariable,
    Function,
    FunctionVariable,
    Place,
    Section,
    Statement,
    When,
)
from hystid.modelica.matrix_functions import is_matrix_function
from hystid.modelica.sections import Carried
from hystid.modelica.spoken import spans, structural_names, unconnected
from hystid.modelica.tables import is_table_object


class Adapter(DictionaryReader):
    """Reads one dictionary: declarations, equations, functions."""

    def model(self, d: Mapping[str, Any], deciding: Set[str]) -> FlatModel:
        """The flat model. deciding: last names of parameters on which components depend.

        Raises ModelicaError for what the subset leaves out.
        """
        self._note_pieces(d)
        self._enumerations = {k: float(v) for k, v in d["enum_literal_ordinals"].items()}
        self._records = d["record_instances"]
        self._record_types = {int(k): r for k, r in d["record_types"].items()}
        self._refuse_sections(d)
        structural = structural_names(d, deciding)
        texts = [v for v in d["variables"].values() if self._is_text(v, d)]
        for v in texts:
            self._note_text(v)
        objects = [v for v in d["variables"].values() if self._is_table(v, d)]
        for v in objects:
            self._here = self._place(v)
            self._texts[v["name"]] = self.expr(v["binding"])
        gone = {v["name"] for v in (*texts, *objects)} | unconnected(d)
        carried = Carried(self, d)
        return FlatModel(
            name=self.name,
            description="",
            variables=tuple(self._variable(v, d, structural) for v in d["variables"].values() if v["name"] not in gone),
            equations=carried.others(self._equations(d["equations"], d["structured_equations"])),
            initial=self._equations(d["initial_equations"], d["initial_structured_equations"]),
            whens=tuple(self._when(w) for w in carried.chains),
            assertions=tuple(self._assertion(a) for a in carried.assertions),
            functions=self._functions(d),
            sections=tuple(Section(self._statements(a["statements"]), self.place(a)) for a in d["initial_algorithms"]),
            texts=tuple(self._built_in(texts)),
            algorithms=tuple(carried.sections),
        )

    def _refuse_sections(self, d: Mapping[str, Any]) -> None:
        table = {
            "algorithms": (
                "this algorithm section in a model (while, return, break, terminate or a when inside an if or a loop)",
                "write equations, or put it into a function",
            ),
            "initial_assert_equations": ("assert in an initial equation", "put the assert among the equations"),
            "branches": ("an overconstrained connector", "use plain connectors"),
        }
        for key, (what, way) in table.items():
            if d.get(key):
                items = d[key]
                first = next(iter(items.values() if isinstance(items, dict) else items))
                node = next(spans(first), {})
                self._here = self._declaration
                self._refuse(node, what, way)

    # -- declarations

    def _variable(self, v: Mapping[str, Any], d: Mapping[str, Any], structural: frozenset[str]) -> FlatVariable:
        place = self._place(v)
        self._here = place
        name = v["name"]
        kind = self._type(v, d)
        if v.get("stream"):
            self._refuse(v, f"stream variable '{name}'", "use plain connectors")
        fixed = v["fixed"]
        variability = _tag(v["variability"])
        enumeration = self._enumeration(v, d)
        start = self._attribute(v, "start")
        return FlatVariable(
            name=name,
            type=kind,
            variability="continuous" if variability in ("empty", "continuous") else variability,  # type: ignore[arg-type]  # one of the words of Modelica
            causality={"input": "input", "output": "output"}.get(_tag(v["causality"]), "local"),  # type: ignore[arg-type]  # the same
            dims=tuple(v["dims"]),
            start=ONE if enumeration and start is None else start,
            fixed=fixed[0] if isinstance(fixed, list) and fixed else fixed,
            min=self._attribute(v, "min"),
            max=self._attribute(v, "max"),
            nominal=self._attribute(v, "nominal"),
            unit=v["unit"] or "",
            description=v["description"] or "",
            binding=self._attribute(v, "binding"),
            final=bool(d["variable_final_flags"].get(name)),
            protected=bool(v["is_protected"]),
            structural=name in structural and variability in ("parameter", "constant"),
            enumeration=enumeration,
            place=place,
            preferred=_tag(v["state_select"]) in ("prefer", "always"),
            evaluate=bool(v["evaluate"]) and variability == "parameter",
            shown=v["display_unit"] or "",
        )

    def _enumeration(self, v: Mapping[str, Any], d: Mapping[str, Any]) -> Enumeration | None:
        """The type of a variable whose values have names, by the name that the author has written; None where that
        names no enumeration, or several."""
        if v["type_id"] not in d["enumeration_types"]:
            return None
        written = d["variable_type_names"].get(v["name"], "")
        found: dict[str, dict[float, str]] = {}
        for literal, value in self._enumerations.items():
            name, _, item = literal.rpartition(".")
            if not item.startswith("'") and f".{name}".endswith(f".{written}"):
                found.setdefault(name, {})[value] = item
        shorter = {name for name in found if any(other.endswith(f".{name}") for other in found)}
        full = [name for name in found if name not in shorter]
        if not written or len(full) != 1:
            return None
        return Enumeration(full[0], tuple(found[full[0]][value] for value in sorted(found[full[0]])))

    def _built_in(self, texts: Sequence[Mapping[str, Any]]) -> Iterator[BuiltInText]:
        """The model's own Strings; those of its components name files and the like."""
        for v in texts:
            value = self._texts[v["name"]]
            if "." not in v["name"] and isinstance(value, Text) and not v["is_protected"]:
                yield BuiltInText(v["name"], value.value, v["description"] or "")

    def _is_text(self, v: Mapping[str, Any], d: Mapping[str, Any]) -> bool:
        """Whether it is a String parameter or constant: its value is built in."""
        return _predefined(v, d) == "string" and _tag(v["variability"]) in ("parameter", "constant")

    def _is_table(self, v: Mapping[str, Any], d: Mapping[str, Any]) -> bool:
        """Whether it is an external object that holds a table; it is written where it is used."""
        call = (v["binding"] or {}).get("FunctionCall") if _predefined(v, d) == "" else None
        return call is not None and is_table_object(call["name"]["name"])

    def _note_text(self, v: Mapping[str, Any]) -> None:
        self._here = self._place(v)
        value = self._attribute(v, "binding")
        if value is None or isinstance(value, Ref):
            self._refuse(v, f"the value of the String '{v['name']}'", "write it as one text in quotes")
        self._texts[v["name"]] = value

    def _attribute(self, v: Mapping[str, Any], key: str) -> Expr | None:
        return self.expr(v[key]) if v[key] is not None else None

    def _type(self, v: Mapping[str, Any], d: Mapping[str, Any]) -> Any:
        kind = _predefined(v, d)
        if kind in ("real", "integer", "boolean"):
            return kind.capitalize()
        what = {"string": "a String variable", "clock": "a Clock"}.get(kind, "a variable of this type")
        self._refuse(v, f"{what} ('{v['name']}')", "use Real, Integer or Boolean")

    # -- equations

    def _equations(
        self, items: Sequence[Mapping[str, Any]], families: Sequence[Mapping[str, Any]]
    ) -> tuple[Equation, ...]:
        """families: what came of for-equations. Of some the front end fills in the first rows only, the others hold 0:
        these are made from the family's template."""
        result = [self._equation(item["residual"], item) for item in items]
        for family in families:
            if not family["interiors_materialized"]:
                first = family["first_equation_index"]
                rows = list(self._rows(family))
                result[first : first + len(rows)] = rows
        return tuple(result)

    def _equation(self, residual: Any, item: Mapping[str, Any]) -> Equation:
        place = self.at(item)
        return Equation(_without_zero(self.expr(residual)), place)

    def _rows(self, family: Mapping[str, Any]) -> Iterator[Equation]:
        """The equations of a family, one for each body at each point of its domain, the last index running fastest."""
        body = family["template"]["body"]
        if len(body) != family["equations_per_point"]:
            self._refuse(family, "this for-equation", "write its equations out")
        templates = [self._equation(residual, residual) for residual in body]
        binders = family["domain"]["binders"]
        names = [b["display_name"] for b in binders]
        ranges = (range(b["lower"], b["upper"] + (1 if b["step"] > 0 else -1), b["step"]) for b in binders)
        for point in itertools.product(*ranges):
            values = dict(zip(names, (Num(float(k)) for k in point), strict=True))
            yield from (replace(e, residual=_at(e.residual, values)) for e in templates)

    def _assertion(self, a: Mapping[str, Any]) -> Assertion:
        place = self.at(a)
        return Assertion(self.expr(a["condition"]), self.expr(a["message"]), self.level(a["level"]), place)

    def level(self, node: Any) -> str:
        """Level of an assertion."""
        level = self.expr(node) if node is not None else Num(2.0)
        return "warning" if level == Num(self._enumerations["AssertionLevel.warning"]) else "error"

    def _when(self, chain: Mapping[str, Any]) -> When:
        return When(tuple(self._branch(b) for b in [chain["first"], *chain["else_when"]]))

    def _branch(self, b: Mapping[str, Any]) -> Branch:
        place = self.at(b)
        condition = self.expr(b["condition"])
        several = condition.args if isinstance(condition, Op) and condition.name == "{}" else (condition,)
        return Branch(tuple(several), tuple(self._actions(b["equations"], None)), place)

    def _actions(self, items: Sequence[Mapping[str, Any]], guard: Expr | None) -> Iterator[Action]:
        for item in items:
            kind, body = next(iter(item.items()))
            place = self.at(body)
            if kind == "Assign":
                yield Action("assign", body["target"], self.expr(body["value"]), place, guard)
            elif kind == "Reinit":
                yield Action("reinit", body["state"], self.expr(body["value"]), place, guard)
            elif kind == "Assert":
                message, level = self.expr(body["message"]), self.level(body.get("level"))
                yield Action("assert", "", self.expr(body["condition"]), place, guard, message, level)
            elif kind == "Conditional":
                yield from self._conditional(body, guard)
            else:
                self._refuse(body, f"{kind.lower()} in a when-clause", REFUSED.get(kind.lower(), "write assignments"))

    def _conditional(self, body: Mapping[str, Any], guard: Expr | None) -> Iterator[Action]:
        so_far: Expr | None = guard
        branches = [(self.expr(c), items) for c, items in body["branches"]]
        if body.get("else_branch"):
            branches.append((ONE, body["else_branch"]))
        for condition, items in branches:
            yield from self._actions(items, _both(so_far, condition))
            so_far = _both(so_far, Op("not", (condition,)))

    # -- functions

    def _functions(self, d: Mapping[str, Any]) -> tuple[Function, ...]:
        """Names in functions are their own: one may be that of a record of the model."""
        outside, self._records = self._records, {}
        made = tuple(self._function(f) for f in d["functions"].values())
        self._records = outside
        return made

    def _function(self, f: Mapping[str, Any]) -> Function:
        place = self._place(f["inputs"][0] if f["inputs"] else f)
        self._here = place
        if f.get("external"):
            known = f["inputs"] if is_matrix_function(f["name"]) else ()
            return Function(f["name"], tuple(map(self._function_variable, known)), (), (), (), place, external=True)
        inputs, outputs, inner = (
            tuple(self._function_variable(v) for v in f[key]) for key in ("inputs", "outputs", "locals")
        )
        return Function(
            f["name"],
            inputs,
            outputs,
            inner,
            body=tuple(s for item in f["body"] for s in self._statement(item)),
            place=place,
        )

    def _function_variable(self, v: Mapping[str, Any]) -> FunctionVariable:
        dims = tuple(Num(-1.0) if "Colon" in s else self._subscript(s) for s in v["shape_expr"])
        default = self.expr(v["default"]) if v["default"] else None
        return FunctionVariable(v["name"], v["type_name"], dims, default, self._fields(v["name"], v))

    def _fields(self, name: str, v: Mapping[str, Any]) -> tuple[FunctionVariable, ...]:
        """The variables of a record."""
        kind = self._record_types.get(v["type_def_id"]) if v["type_class"] == "Record" else None
        if kind is None:
            return ()
        if v["shape_expr"]:
            self._refuse(v, f"the array of records '{name}' in a function", "arrays of numbers")
        return tuple(
            FunctionVariable(f"{name}.{f['name']}", "", tuple(Num(float(n)) for n in f["dims"])) for f in kind["fields"]
        )

    def _statement(self, item: Mapping[str, Any]) -> Iterator[Statement]:
        kind, body = next(iter(item.items())) if isinstance(item, dict) else (str(item), {})
        place = self.at(body)
        if kind == "Assignment":
            yield Statement("assign", place, (self._target(body["comp"]),), self.expr(body["value"]))
        elif kind == "FunctionCall" and body.get("outputs"):
            targets = tuple(
                self._target(o) if isinstance(o, dict) and "parts" in o else self._lvalue(o) for o in body["outputs"]
            )
            call = Op("call " + _dotted(body["comp"]), tuple(self.expr(a) for a in body["args"]))
            yield Statement("assign", place, targets, call)
        elif kind == "If":
            blocks = [(self.expr(b["cond"]), b["stmts"]) for b in body["cond_blocks"]]
            blocks += [(ONE, body["else_block"])] if body.get("else_block") else []
            yield Statement("if", place, branches=tuple((c, self._statements(s)) for c, s in blocks))
        elif kind == "For":
            yield self._loop(body, place)
        elif kind in ("Assert", "Empty"):
            return
        else:
            self._refuse(body, f"a {kind.lower()} statement", "functions may hold assignments, if and for")

    def _statements(self, items: Sequence[Mapping[str, Any]]) -> tuple[Statement, ...]:
        return tuple(s for item in items for s in self._statement(item))

    def _loop(self, body: Mapping[str, Any], place: Place) -> Statement:
        inner = self._statements(body["equations"])
        for index in reversed(body["indices"]):
            inner = (Statement("for", place, (), self.expr(index["range"]), ((ONE, inner),), index["ident"]),)
        return inner[0]

    def _target(self, comp: Mapping[str, Any]) -> Expr:
        *front, last = comp["parts"]
        subscripts = last["subs"] or ()
        base = Ref(".".join([*(self._element(part) for part in front), last["ident"]]))
        return Op("[]", (base, *(self._subscript(s) for s in subscripts))) if subscripts else base

    def _element(self, part: Mapping[str, Any]) -> str:
        """Name of a component, an element of an array maybe."""
        numbers = [self._subscript(s) for s in part["subs"] or ()]
        if not all(isinstance(n, Num) for n in numbers):
            what = f"a computed subscript of '{part['ident']}' on the left of an assignment"
            self._refuse(part, what, "write the assignments out")
        inside = ",".join(f"{n.value:g}" for n in numbers if isinstance(n, Num))
        return f"{part['ident']}[{inside}]" if numbers else str(part["ident"])


def _predefined(v: Mapping[str, Any], d: Mapping[str, Any]) -> str:
    """Name of the predefined type of a variable; an enumeration counts as an Integer, "" for any other type."""
    number = v["type_id"]
    effective = d["effective_types"].get(str(number))
    canonical = effective["canonical_type"] if effective else number
    if canonical in d["enumeration_types"] or number in d["enumeration_types"]:
        return "integer"
    return next((k for k, n in d["predefined_types"].items() if n == canonical), "")


def _at(expr: Expr, values: Mapping[str, Expr]) -> Expr:
    """The expression with loop indices replaced, nothing else changed; a comprehension's own indices are its own."""
    if isinstance(expr, Ref):
        return values.get(expr.name, expr)
    if not isinstance(expr, Op):
        return expr
    if expr.name == "for":
        own = {name.name for name in expr.args[1::2] if isinstance(name, Ref)}
        inside = {name: value for name, value in values.items() if name not in own}
        ranges = (
            part for name, r in zip(expr.args[1::2], expr.args[2::2], strict=True) for part in (name, _at(r, values))
        )
        return Op("for", (_at(expr.args[0], inside), *ranges))
    return Op(expr.name, tuple(_at(a, values) for a in expr.args))


def _without_zero(residual: Expr) -> Expr:
    """An if-equation inside another arrives as (if ...) - 0, which would hide the equations in its branches."""
    if not (isinstance(residual, Op) and residual.name in ("-", "if")):
        return residual
    first, *rest = residual.args
    if residual.name == "if":
        return Op("if", (first, *(_without_zero(branch) for branch in rest)))
    inner = isinstance(first, Op) and first.name == "if" and rest == [ZERO]
    return _without_zero(first) if inner else residual


def _tag(value: Any) -> str:
    return (next(iter(value)) if isinstance(value, dict) else str(value)).lower()


def _both(a: Expr | None, b: Expr) -> Expr:
    return b if a is None or a == ONE else a if b == ONE else Op("and", (a, b))


def _dotted(comp: Mapping[str, Any]) -> str:
    return str(comp["name"]) if "name" in comp else ".".join(part["ident"] for part in comp["parts"])
