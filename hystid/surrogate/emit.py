"""``Program`` -> C text: one function for the values, one for a directional derivative, one for the adjoint.

    void NAME(const double *in_a, ..., double *out_b, ...)
    void NAME_forward(in..., const double *d_in..., double *out..., double *d_out...)
    void NAME_adjoint(in..., double *d_in..., double *out..., const double *d_out...)     d_in += d_out . d out / d in

All three are pure functions of their arguments. Locals live on the stack, or in ``work`` where they are large.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from hystid.surrogate.functions import C_HELPERS, FUNCTIONS
from hystid.surrogate.identifiers import readable
from hystid.surrogate.loops import Lines, Nest, number, over, pointer
from hystid.surrogate.program import Elementwise, Gather, MatMul, Program, Reduce, Statement
from hystid.surrogate.tensors import Buffer, View

STACK_LIMIT = 4096  # doubles in locals of one function; beyond, the instance's own memory is used
MANY = 60  # statements, as of two members of an ensemble; beyond, a compiler's time matters more than its inlining
_APART = """\
/* A large network is compiled in good time: its matrix products are called, and what joins them is not polished. */
#if defined(__clang__)
#define NN_APART __attribute__((noinline))
#define NN_PLAIN
#elif defined(__GNUC__)
#define NN_APART __attribute__((noinline, noclone))
#define NN_PLAIN __attribute__((optimize("O1")))
#else
#define NN_APART
#define NN_PLAIN
#endif

"""
_OPERANDS = "abc"


@dataclass(frozen=True)
class Functions:
    """Generated text. tables: constants and helpers that the functions need. work: doubles that ``work`` must hold."""

    tables: str
    value: str
    forward: str
    adjoint: str
    work: int


def functions(program: Program, name: str) -> Functions:
    """C text of a program; the functions are called ``name``, ``name_forward`` and ``name_adjoint``."""
    active = active_buffers(program)
    value = _Writer(program, name, active, "value")
    forward = _Writer(program, name, active, "forward")
    adjoint = _Writer(program, name, active, "adjoint")
    texts = (value.text(), forward.text(), adjoint.text())
    used = "".join(texts)
    helpers = _helpers(used)
    if len(program.statements) > MANY:
        helpers = _APART + helpers.replace("static void nn_", "NN_APART static void nn_")
        texts = (_plain(texts[0]), _plain(texts[1]), _plain(texts[2]))
    return Functions(helpers + _tables(program, used), *texts, max(w.work for w in (value, forward, adjoint)))


def value_function(program: Program, name: str) -> Functions:
    """As ``functions``, without the derivatives and what only they need."""
    writer = _Writer(program, name, active_buffers(program), "value")
    text = writer.text()
    return Functions(_helpers(text) + _tables(program, text), text, "", "", writer.work)


def _plain(text: str) -> str:
    return text.replace("static void", "NN_PLAIN static void", 1)


def active_buffers(program: Program) -> frozenset[Buffer]:
    """Buffers that lie on a smooth path from a float input to an output, those at its ends included."""
    reached = {port.view.buffer for port in program.inputs if port.view.kind == "float"}
    for statement in program.statements:
        if any(view.buffer in reached for _, view in _derivatives(statement)):
            reached.add(statement.out.buffer)
    wanted = {port.view.buffer for port in program.outputs}
    for statement in reversed(program.statements):
        if statement.out.buffer in wanted:
            wanted.update(view.buffer for _, view in _derivatives(statement))
    return frozenset(reached & wanted)


def _derivatives(statement: Statement) -> Iterator[tuple[str, View]]:
    """Partial derivative (a C expression, for element-wise statements) and operand, where it is not zero."""
    if isinstance(statement, Elementwise):
        for partial, view in zip(FUNCTIONS[statement.function].partials, statement.operands, strict=False):
            if partial is not None and not view.is_constant:
                yield partial, view
    else:
        yield from (("", view) for view in statement.operands if not view.is_constant)


def _helpers(text: str) -> str:
    wanted: list[str] = []

    def add(name: str) -> None:
        for other in C_HELPERS[name][1]:
            add(other)
        if name not in wanted:
            wanted.append(name)

    for name in C_HELPERS:
        if name + "(" in text:
            add(name)
    return "".join(C_HELPERS[name][0] + "\n" for name in wanted)


def _tables(program: Program, text: str) -> str:
    """Constants that the text refers to by name."""
    lines: Lines = []
    for buffer in program.buffers:
        if buffer.values is not None and re.search(rf"\b{buffer.name}\b", text):
            lines += _table("static const double", buffer.name, [number(v).strip("()") for v in buffer.values])
    for place, statement in enumerate(program.statements):
        if isinstance(statement, Gather):
            lines += _table(
                "static const int", f"at_{place}", [str(i) for i in statement.index + statement.source.offset]
            )
    return "\n".join(lines) + "\n"


def _table(kind: str, name: str, items: Sequence[str]) -> Lines:
    width = max(1, 110 // (max(len(item) for item in items) + 2))
    rows = [", ".join(items[i : i + width]) for i in range(0, len(items), width)]
    return [f"{kind} {name}[{len(items)}] = {{", *(f"    {row}," for row in rows), "};"]


@dataclass
class _Writer:
    program: Program
    name: str
    active: frozenset[Buffer]
    mode: str
    lines: Lines = field(default_factory=list)
    work: int = 0

    def text(self) -> str:
        """The whole function."""
        self._declare()
        note = None
        for place, statement in enumerate(self.program.statements):
            if statement.note != note:
                self.lines.append(f"    /* {readable(statement.note)} */")
                note = statement.note
            self._value(place, statement)
            if self.mode == "forward":
                self._forward(place, statement)
        if self.mode == "adjoint":
            self.lines.append("    /* backwards */")
            for place, statement in reversed(list(enumerate(self.program.statements))):
                self._adjoint(place, statement)
        return "\n".join([self._head(), "{", *self.lines, "}", ""])

    def _head(self) -> str:
        suffix = "" if self.mode == "value" else "_" + self.mode
        d_in, d_out = ("double *", "const double *") if self.mode == "adjoint" else ("const double *", "double *")
        arguments = []
        for ports, plain, slope in (
            (self.program.inputs, "const double *", d_in),
            (self.program.outputs, "double *", d_out),
        ):
            arguments += [f"{plain}restrict {port.view.buffer.name}" for port in ports]
            if self.mode != "value":
                arguments += [f"{slope}restrict d_{port.view.buffer.name}" for port in ports]
        return f"static void {self.name}{suffix}({', '.join([*arguments, 'double *restrict work'])})"

    def _declare(self) -> None:
        """Locals on the stack or in ``work``; arguments that a network ignores are marked as such."""
        wanted = [b for b in self.program.buffers if b.role == "local"]
        slots = [(b.name, b.size) for b in wanted]
        if self.mode != "value":
            slots += [("d_" + b.name, b.size) for b in wanted if b in self.active]
        total = sum(size for _, size in slots)
        if total > STACK_LIMIT:
            self.work = total
        at = 0
        for slot, size in slots:
            if self.work:
                self.lines.append(f"    double *const {slot} = work + {at};")
                at += size
            elif slot.startswith("d_") and self.mode == "adjoint":
                self.lines.append(f"    double {slot}[{size}] = {{0}};")
            else:
                self.lines.append(f"    double {slot}[{size}];")
        if self.work and self.mode == "adjoint":
            self.lines.append(f"    memset(work, 0, {total} * sizeof *work);")
        names = [port.view.buffer.name for port in (*self.program.inputs, *self.program.outputs)]
        silent = ["work", *names, *(["d_" + name for name in names] if self.mode != "value" else [])]
        self.lines.append("    " + " ".join(f"(void){name};" for name in silent))

    # values

    def _value(self, place: int, statement: Statement) -> None:
        if isinstance(statement, Elementwise):
            if statement.function == "tanh" and _in_a_row(statement.out, *statement.operands):
                n, x, y = statement.out.size, pointer(statement.operands[0]), pointer(statement.out)
                self.lines.append(f"    nn_tanh_all({n}, {x}, {y});")
                return
            expression = FUNCTIONS[statement.function].c
            self._loop(statement, lambda n: [f"{n.at(statement.out)} = {_fill(expression, statement, n)};"])
        elif isinstance(statement, MatMul):
            self._product(statement)
        elif isinstance(statement, Reduce):
            self._reduction(statement)
        else:
            source = statement.source.buffer.name
            self._loop(statement, lambda n: [f"{n.at(statement.out)} = {source}[at_{place}[{n.counter()}]];"])

    def _product(self, s: MatMul) -> None:
        if _is_dense(s):
            bias = "0" if s.bias is None else pointer(s.bias)
            self.lines.append(f"    nn_dense({_dense_arguments(s)}, {pointer(s.a)}, {bias}, {pointer(s.out)});")
            return
        rows, columns, inner = s.out.shape[0], s.out.shape[1], s.a.shape[1]
        outer = Nest((rows, columns))
        start = "0.0" if s.bias is None else outer.at(s.bias)
        deep = Nest((rows, columns, inner))
        a, b = over(s.a, (rows, columns, inner), (0, 2)), over(s.b, (rows, columns, inner), (2, 1))
        self.lines += outer.wrap(
            [
                f"double sum = {start};",
                *deep.inner_wrap([f"sum += {deep.at(a)} * {deep.at(b)};"], 2),
                f"{outer.at(s.out)} = sum;",
            ]
        )

    def _reduction(self, s: Reduce) -> None:
        rank = len(s.out.shape)
        deep, outer = Nest(s.operand.shape), Nest(s.out.shape)
        value = deep.at(s.operand)
        if s.function == "sum":
            start, line = "0.0", f"result += {value};"
        else:
            start, sign = ("-INFINITY", ">") if s.function == "max" else ("INFINITY", "<")
            line = f"if ({value} {sign} result || {value} != {value}) result = {value};"
        body = [f"double result = {start};", *deep.inner_wrap([line], rank), f"{outer.at(s.out)} = result;"]
        self.lines += outer.wrap(body)

    # directional derivative

    def _forward(self, place: int, statement: Statement) -> None:
        if statement.out.buffer not in self.active:
            return
        if isinstance(statement, Elementwise):
            pairs = [(p, v) for p, v in _derivatives(statement) if v.buffer in self.active]
            self._loop(
                statement,
                lambda n: [
                    f"{n.at(statement.out, 'd_')} = "
                    + (" + ".join(_times(_fill(p, statement, n), n.at(v, "d_")) for p, v in pairs) or "0.0")
                    + ";"
                ],
            )
        elif isinstance(statement, MatMul):
            self._product_forward(statement)
        elif isinstance(statement, Reduce):
            self._reduction_derivative(statement, back=False)
        else:
            source = f"d_{statement.source.buffer.name}"
            self._loop(statement, lambda n: [f"{n.at(statement.out, 'd_')} = {source}[at_{place}[{n.counter()}]];"])

    def _reduction_derivative(self, s: Reduce, back: bool) -> None:
        deep, outer = Nest(s.operand.shape), Nest(s.out.shape)
        here, there = deep.at(s.operand, "d_"), outer.at(s.out, "d_")
        line = f"{here} += {there};" if back else f"result += {here};"
        start, end = ([], []) if back else (["double result = 0.0;"], [f"{there} = result;"])
        if s.function != "sum":  # the first of equal elements is the one that counts
            line = f"if (!found && {deep.at(s.operand)} == {outer.at(s.out)}) {{ {line} found = 1; }}"
            start.append("int found = 0;")
        self.lines += outer.wrap([*start, *deep.inner_wrap([line], len(s.out.shape)), *end])

    def _product_forward(self, s: MatMul) -> None:
        bias = s.bias if s.bias is not None and s.bias.buffer in self.active else None
        if _is_dense(s) and bias is None and s.b.buffer not in self.active:
            self.lines.append(f"    nn_dense({_dense_arguments(s)}, {pointer(s.a, 'd_')}, 0, {pointer(s.out, 'd_')});")
            return
        shape = (s.out.shape[0], s.out.shape[1], s.a.shape[1])
        outer, deep = Nest(shape[:2]), Nest(shape)
        a, b = over(s.a, shape, (0, 2)), over(s.b, shape, (2, 1))
        start = "0.0" if bias is None else outer.at(bias, "d_")
        terms = []
        if s.a.buffer in self.active:
            terms.append(f"{deep.at(a, 'd_')} * {deep.at(b)}")
        if s.b.buffer in self.active:
            terms.append(f"{deep.at(a)} * {deep.at(b, 'd_')}")
        inner = deep.inner_wrap([f"sum += {' + '.join(terms)};"], 2) if terms else []
        self.lines += outer.wrap([f"double sum = {start};", *inner, f"{outer.at(s.out, 'd_')} = sum;"])

    # adjoint

    def _adjoint(self, place: int, statement: Statement) -> None:
        if statement.out.buffer not in self.active:
            return
        targets = [(p, v) for p, v in _derivatives(statement) if v.buffer in self.active]
        if isinstance(statement, Elementwise):
            self._loop(
                statement,
                lambda n: [
                    f"{n.at(v, 'd_')} += {_times(_fill(p, statement, n), n.at(statement.out, 'd_'))};"
                    for p, v in targets
                ],
            )
        elif isinstance(statement, MatMul):
            self._product_adjoint(statement)
        elif isinstance(statement, Reduce):
            self._reduction_derivative(statement, back=True)
        else:
            source = f"d_{statement.source.buffer.name}"
            self._loop(statement, lambda n: [f"{source}[at_{place}[{n.counter()}]] += {n.at(statement.out, 'd_')};"])

    def _product_adjoint(self, s: MatMul) -> None:
        shape = (s.out.shape[0], s.out.shape[1], s.a.shape[1])
        outer, deep = Nest(shape[:2]), Nest(shape)
        a, b = over(s.a, shape, (0, 2)), over(s.b, shape, (2, 1))
        slope = deep.at(over(s.out, shape, (0, 1)), "d_")
        body = []
        if _is_dense(s) and s.a.buffer in self.active and s.b.buffer not in self.active:
            back = f"{pointer(s.out, 'd_')}, {pointer(s.a, 'd_')}"
            self.lines.append(f"    nn_dense_back({_dense_arguments(s)}, {back});")
        elif s.a.buffer in self.active:
            body.append(f"{deep.at(a, 'd_')} += {slope} * {deep.at(b)};")
        if s.b.buffer in self.active:
            body.append(f"{deep.at(b, 'd_')} += {slope} * {deep.at(a)};")
        if body:
            self.lines += deep.wrap(body)
        if s.bias is not None and s.bias.buffer in self.active:
            self.lines += outer.wrap([f"{outer.at(s.bias, 'd_')} += {outer.at(s.out, 'd_')};"])

    def _loop(self, statement: Statement, body: Callable[[Nest], Lines]) -> None:
        views = [statement.out] if isinstance(statement, Gather) else [statement.out, *statement.operands]
        nest = Nest.merged(views)
        lines = body(nest)
        if lines:
            self.lines += nest.wrap(lines)


def _in_a_row(*views: View) -> bool:
    return all(view.is_contiguous and view.size > 1 and not view.is_constant for view in views)


def _is_dense(s: MatMul) -> bool:
    """Whether the product is that of a layer: one row times a matrix that lies row by row as W of W x."""
    rows, columns = s.out.shape
    shaped = rows == 1 and columns > 1 and s.a.shape[1] > 1 and s.b.strides == (1, s.a.shape[1])
    biased = s.bias is None or (s.bias.strides[1] == 1 and (not s.bias.is_constant or s.bias.buffer.size > 1))
    return shaped and biased and s.a.is_contiguous and s.out.is_contiguous and not s.a.is_constant


def _dense_arguments(s: MatMul) -> str:
    return f"{s.out.shape[1]}, {s.a.shape[1]}, {pointer(s.b)}"


def _fill(expression: str, statement: Elementwise, nest: Nest) -> str:
    values = dict(zip(_OPERANDS, map(nest.at, statement.operands), strict=False))
    return expression.format(y=nest.at(statement.out), **values)


def _times(factor: str, term: str) -> str:
    return {"1.0": term, "-1.0": f"-{term}"}.get(factor, f"({factor}) * {term}")
