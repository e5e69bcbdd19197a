"""Expressions of the front end's dictionary, and the places in the sources that its byte offsets mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NoReturn

from hystid.errors import ModelicaError
from hystid.modelica.connections import Connections, is_connection
from hystid.modelica.diagnostics import REFUSED, declared_at
from hystid.modelica.expr import ONE, ZERO, Expr, Num, Op, Ref, Text, balanced_sum
from hystid.modelica.flat import Place
from hystid.modelica.sources import Source
from hystid.modelica.spoken import dictionaries, spans

_BINARY = {
    "Add": "+", "Sub": "-", "Mul": "*", "Div": "/", "Exp": "^", "And": "and", "Or": "or",
    "AddElem": "+", "SubElem": "-", "MulElem": ".*", "DivElem": "./", "ExpElem": ".^",
    "Lt": "<", "Le": "<=", "Gt": ">", "Ge": ">=", "Eq": "==", "Neq": "<>", "Ne": "<>",
}  # fmt: skip
_UNARY = {"Minus": "neg", "Not": "not", "Plus": "+", "DotMinus": "neg", "DotPlus": "+"}

# The front end is asked for this class, which extends the wanted one.
ASKED_FOR = "HystidStructure"


class DictionaryReader:
    """Reads expressions of one dictionary; sources give lines to byte offsets."""

    def __init__(self, name: str, sources: Sequence[Source]) -> None:
        self.name = name
        self.sources = sources
        self._origin: dict[int, Source | None] = {}
        self._enumerations: dict[str, float] = {}
        self._pieces: dict[int, dict[tuple[int, int], str]] = {}
        self._records: Mapping[str, Any] = {}
        self._record_types: Mapping[int, Any] = {}
        self._texts: dict[str, Expr] = {}
        self._here: Place | None = None

    # -- places

    def _note_pieces(self, node: Any) -> None:
        """Collects identifiers with their offsets by source number, to find out which file a number means."""
        for piece in dictionaries(node):
            span = piece.get("span")
            if isinstance(span, dict) and ("ident" in piece or "subscripts" in piece):
                word = piece.get("ident") or _last_name(piece)
                pieces = self._pieces.setdefault(span["source"], {})
                if word and len(pieces) < 200:
                    pieces[(span["start"], span["end"])] = word

    def _source(self, number: int) -> Source | None:
        if number not in self._origin:
            pieces = self._pieces.get(number, {})
            scored = [(sum(s.piece(*span).endswith(word) for span, word in pieces.items()), s) for s in self.sources]
            best = max(scored, key=lambda item: item[0], default=(0, None))
            self._origin[number] = best[1] if best[0] else None
        return self._origin[number]

    def _place(self, node: Mapping[str, Any]) -> Place:
        span = node.get("span") or node.get("source_span")
        source = self._source(span["source"]) if span else None
        if span is None or source is None:
            return self._declaration
        return Place(str(source.path), source.line(span["start"]))

    @cached_property
    def _connections(self) -> Connections:
        return Connections(self.sources)

    @cached_property
    def _declaration(self) -> Place:
        """Where the model itself is declared: for what the front end made without a place of its own."""
        return Place(declared_at(self.name, self.sources))

    def _refuse(self, node: Mapping[str, Any], what: str, way: str) -> NoReturn:
        place = self._place(node) if "span" in node else self._here or self._place(node)
        raise ModelicaError(f"{place}: {what} is not supported: {way}")

    def place(self, item: Mapping[str, Any]) -> Place:
        """The first line of an equation; of a connection, that of its clause, or of the model where none is found."""
        origin = item.get("origin")
        if origin and is_connection(origin):
            return self._connections.place(origin) or self._declaration
        known = (n for n in spans(item) if self._source(n["span"]["source"]) is not None)
        first = next(known, None)
        return self._declaration if first is None else self._place(first)

    def at(self, item: Mapping[str, Any]) -> Place:
        """Where an equation stands; complaints about what is read next name it."""
        self._here = self.place(item)
        return self._here

    def _lvalue(self, node: Any) -> Expr | None:
        return self.expr(node) if node is not None and node != "Empty" else None

    # -- expressions

    def expr(self, node: Any) -> Expr:
        """An expression; ModelicaError for a kind outside the subset."""
        if not isinstance(node, dict):
            self._refuse({}, f"expression '{node}'", "write it in another way")
        kind, body = next(iter(node.items()))
        reader = getattr(self, "_read_" + kind, None)
        if reader is None:
            self._refuse(body if isinstance(body, dict) else {}, f"the construct '{kind}'", "write it in another way")
        result: Expr = reader(body)
        return result

    def _read_Literal(self, b: Mapping[str, Any]) -> Expr:
        kind, value = next(iter(b["value"].items()))
        if kind == "String":
            return Text(self._instance(value))
        return ONE if value is True else ZERO if value is False else Num(float(value))

    def _instance(self, text: str) -> str:
        """What getInstanceName() gives begins with the last name of the model (specification 3.6, section 3.7.4.3), and
        here with the class that the front end was asked for."""
        first, dot, rest = text.partition(".")
        return f"{self.name.rsplit('.', 1)[-1]}{dot}{rest}" if first == ASKED_FOR else text

    def _read_VarRef(self, b: Mapping[str, Any]) -> Expr:
        name = b["name"]["name"] if isinstance(b["name"], dict) else b["name"]
        if name in self._enumerations:
            return Num(self._enumerations[name])
        if name in self._texts:
            return self._texts[name]
        if name in self._records:
            return self._record(b, name)
        if not b["subscripts"]:
            return Ref(name)
        return Op("[]", (Ref(name), *(self._subscript(s) for s in b["subscripts"])))

    def _record(self, b: Mapping[str, Any], name: str) -> Expr:
        """The fields of a record that stands as a whole."""
        instance = self._records[name]
        kind = self._record_types.get(instance["type_def_id"])
        if kind is None or instance["dims"] or b["subscripts"]:
            self._refuse(b, f"the record '{name}' as a whole", "use its fields, in equations and as arguments")
        fields = [f["name"] for f in kind["fields"]]
        parts = (self._record(b, n) if n in self._records else Ref(n) for n in (f"{name}.{f}" for f in fields))
        return Op("record", tuple(p for f, value in zip(fields, parts, strict=True) for p in (Text(f), value)))

    def _constructed(self, b: Mapping[str, Any], name: str) -> Expr:
        """A record constructor with a value for each field."""
        kinds = [k for k in self._record_types.values() if f".{k['name']}".endswith(f".{name}")]
        args = [self.expr(a) for a in b["args"]]
        if len(kinds) != 1 or len(kinds[0]["fields"]) != len(args):
            self._refuse(b, f"record constructor '{name}' without a value for each field", "give all of them, in order")
        names = (Text(f["name"]) for f in kinds[0]["fields"])
        return Op("record", tuple(p for pair in zip(names, args, strict=True) for p in pair))

    def _subscript(self, s: Mapping[str, Any]) -> Expr:
        kind, body = next(iter(s.items()))
        if kind == "Index":
            return Num(float(body["value"]))
        if kind == "Colon":
            return Op(":", ())
        return self.expr(body["expr"])

    def _read_Binary(self, b: Mapping[str, Any]) -> Expr:
        if b["op"] not in _BINARY:
            self._refuse(b, f"operator '{b['op']}'", "write it in another way")
        if b["op"] == "Add":
            return balanced_sum([self.expr(term) for term in _added(b)])
        lhs, rhs = self.expr(b["lhs"]), self.expr(b["rhs"])
        if isinstance(lhs, Text) and isinstance(rhs, Text) and b["op"] in ("Eq", "Neq", "Ne"):
            return ONE if (lhs == rhs) == (b["op"] == "Eq") else ZERO
        return Op(_BINARY[b["op"]], (lhs, rhs))

    def _read_Unary(self, b: Mapping[str, Any]) -> Expr:
        name = _UNARY[b["op"]]
        operand = self.expr(b["rhs"])
        if isinstance(operand, Num) and name == "neg":
            return Num(-operand.value)
        return operand if name == "+" else Op(name, (operand,))

    def _read_If(self, b: Mapping[str, Any]) -> Expr:
        result = self.expr(b["else_branch"])
        for condition, value in reversed(b["branches"]):
            result = Op("if", (self.expr(condition), self.expr(value), result))
        return result

    def _read_Array(self, b: Mapping[str, Any]) -> Expr:
        kind = {"Array": "{}", "Horizontal": "[,]", "Vertical": "[;]"}.get(b.get("kind", "Array"), "{}")
        return Op(kind, tuple(self.expr(e) for e in b["elements"]))

    def _read_Tuple(self, b: Mapping[str, Any]) -> Expr:
        return Op("tuple", tuple(self._lvalue(e) or Op("nothing", ()) for e in b["elements"]))

    def _read_Range(self, b: Mapping[str, Any]) -> Expr:
        step = self.expr(b["step"]) if b["step"] is not None else ONE
        return Op("range", (self.expr(b["start"]), step, self.expr(b["end"])))

    def _read_ArrayComprehension(self, b: Mapping[str, Any]) -> Expr:
        if b.get("filter") is not None:
            self._refuse(b, "a filter in a comprehension", "write the array out")
        loops = [part for i in b["indices"] for part in (Ref(i["name"]), self.expr(i["range"]))]
        return Op("for", (self.expr(b["expr"]), *loops))

    def _read_Index(self, b: Mapping[str, Any]) -> Expr:
        return Op("[]", (self.expr(b["base"]), *(self._subscript(s) for s in b["subscripts"])))

    def _read_FieldAccess(self, b: Mapping[str, Any]) -> Expr:
        return Op("field", (self.expr(b["base"]), Text(b["field"])))

    def _read_BuiltinCall(self, b: Mapping[str, Any]) -> Expr:
        name = b["function"][0].lower() + b["function"][1:]
        if name in REFUSED:
            self._refuse(b, f"{name}()", REFUSED[name])
        return Op(name, tuple(self.expr(a) for a in b["args"]))

    def _read_FunctionCall(self, b: Mapping[str, Any]) -> Expr:
        name = b["name"]["name"] if isinstance(b["name"], dict) else b["name"]
        if b.get("is_constructor"):
            return self._constructed(b, name)
        if name in REFUSED:
            self._refuse(b, f"{name}()", REFUSED[name])
        return Op("call " + name, tuple(self.expr(a) for a in b["args"]))

    def _read_StringConversion(self, b: Mapping[str, Any]) -> Expr:
        return Op("String", (self.expr(b["value"]),))


def _last_name(node: Mapping[str, Any]) -> str:
    """Last identifier of a variable reference, "" where it carries subscripts."""
    name = node["name"]["name"] if isinstance(node.get("name"), dict) else ""
    last = str(name).rsplit(".", 1)[-1]
    return last if last.isidentifier() and not node["subscripts"] else ""


def _added(binary: Mapping[str, Any]) -> list[Any]:
    """Terms of a sum written a + b + c + ..., which the front end nests to the left."""
    terms = [binary["rhs"]]
    node = binary["lhs"]
    while "Binary" in node and node["Binary"]["op"] == "Add":
        terms.append(node["Binary"]["rhs"])
        node = node["Binary"]["lhs"]
    return [node, *reversed(terms)]
