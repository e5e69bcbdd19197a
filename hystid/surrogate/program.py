"""The compiler's intermediate form: a few kinds of statement over views, and the builder that makes them.

Four statements are enough for feed-forward and recurrent networks, and only these four need derivative rules:
element-wise functions, matrix products, reductions, and tables of indices. Whatever has constant operands is computed
while building, so a finished program holds no statement whose result is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import prod
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hystid.limits import COMPILE_ELEMENTS, room_for
from hystid.surrogate.functions import FUNCTIONS
from hystid.surrogate.identifiers import Names
from hystid.surrogate.tensors import Buffer, Kind, Values, View, broadcast_shape, whole

Reduction = Literal["sum", "max", "min"]

MOST_ELEMENTS = 1_000_000  # of one tensor


@dataclass(frozen=True, eq=False)
class Elementwise:
    """out[...] = function(operands[...]); all views have the same shape. note: the ONNX node it comes from."""

    function: str
    out: View
    operands: tuple[View, ...]
    note: str = ""


@dataclass(frozen=True, eq=False)
class MatMul:
    """out[i, j] = bias[i, j] + sum over k of a[i, k] b[k, j]; bias may be absent."""

    out: View
    a: View
    b: View
    bias: View | None
    note: str = ""

    @property
    def operands(self) -> tuple[View, ...]:
        """a, b and, where there is one, the bias."""
        return (self.a, self.b) if self.bias is None else (self.a, self.b, self.bias)


@dataclass(frozen=True, eq=False)
class Reduce:
    """out[i...] = sum, max or min over j... of operand[i..., j...]; at least one j."""

    function: Reduction
    out: View
    operand: View
    note: str = ""

    @property
    def operands(self) -> tuple[View, ...]:
        """The one operand."""
        return (self.operand,)


@dataclass(frozen=True, eq=False)
class Gather:
    """out[i] = source[index[i]], both one-dimensional and contiguous; index is constant."""

    out: View
    source: View
    index: NDArray[np.int64]
    note: str = ""

    @property
    def operands(self) -> tuple[View, ...]:
        """The source."""
        return (self.source,)


Statement = Elementwise | MatMul | Reduce | Gather


@dataclass(frozen=True, eq=False)
class Port:
    """An input or output of the network: its name in the ONNX file, its view, and whether it is float, int or bool."""

    name: str
    view: View


@dataclass(frozen=True, eq=False)
class Program:
    """A network as straight-line code. Every element of every local buffer is assigned once, before it is read."""

    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    statements: tuple[Statement, ...]

    @property
    def buffers(self) -> tuple[Buffer, ...]:
        """All buffers that the statements touch, each once, in order of appearance."""
        found: dict[Buffer, None] = {}
        for statement in self.statements:
            for view in (*statement.operands, statement.out):
                found.setdefault(view.buffer)
        return tuple(found)


@dataclass
class Builder:
    """Makes statements, computing at once what depends on constants only."""

    names: Names = field(default_factory=Names)
    statements: list[Statement] = field(default_factory=list)
    note: str = ""  # the node being built, for comments
    hint: str = "t"  # its result's name, for identifiers

    def room(self, shape: Sequence[int]) -> int:
        """Number of elements of a shape, asked for before they are made. Raises ValueError beyond the budget."""
        if any(n < 0 for n in shape):
            raise ValueError(f"the shape {list(shape)} has a negative length")
        size = prod(int(n) for n in shape)
        if size > MOST_ELEMENTS:
            raise ValueError(f"its result has more than {MOST_ELEMENTS} elements, which is too large to compile")
        if not room_for(size):
            raise ValueError(f"the network has more than {COMPILE_ELEMENTS}, which is too large to compile")
        return size

    def constant(self, values: ArrayLike) -> View:
        """A table of known numbers; float, int or bool after the array's type."""
        array = np.asarray(values)
        kind: Kind = {"b": "bool", "i": "int", "u": "int"}.get(array.dtype.kind, "float")  # type: ignore[assignment]
        flat = np.ascontiguousarray(array, dtype=np.float64).reshape(-1)
        return whole(Buffer(self.names.unique("c_" + self.hint), flat.size, "constant", flat), array.shape, kind)

    def local(self, shape: Sequence[int], kind: Kind = "float") -> View:
        """A new local array."""
        return whole(Buffer(self.names.unique("t_" + self.hint), self.room(shape), "local"), shape, kind)

    def apply(self, function: str, *operands: View) -> View:
        """Element-wise function with broadcasting; ValueError where the shapes do not broadcast."""
        shape = broadcast_shape([view.shape for view in operands])
        self.room(shape)
        if all(view.is_constant for view in operands):
            return self.constant(FUNCTIONS[function].numpy(*(view.numpy() for view in operands)))
        out = self.local(shape, _kind_of(function, operands))
        self.statements.append(Elementwise(function, out, tuple(view.expand(shape) for view in operands), self.note))
        return out

    def copy_into(self, out: View, source: View) -> None:
        """Assign a view element by element."""
        self.statements.append(Elementwise("copy", out, (source.expand(out.shape),), self.note))

    def reshape(self, view: View, shape: Sequence[int]) -> View:
        """The same elements under another shape, copied only where the view cannot be re-read that way."""
        same = view.reshape(shape)
        if same is not None:
            return same
        copied = self.contiguous(view).reshape(shape)
        assert copied is not None
        return copied

    def contiguous(self, view: View) -> View:
        """This view, or a copy of it, with its elements in a row."""
        if view.is_contiguous:
            return view
        if view.is_constant:
            return self.constant(view.numpy())
        out = self.local(view.shape, view.kind)
        self.copy_into(out, view)
        return out

    def concat(self, views: Sequence[View], axis: int) -> View:
        """Tensors one behind the other along an axis."""
        shape = list(views[0].shape)
        shape[axis] = sum(view.shape[axis] for view in views)
        if all(view.is_constant for view in views):
            self.room(shape)
            return self.constant(np.concatenate([view.numpy() for view in views], axis))
        out, at = self.local(shape, views[0].kind), 0
        for view in views:
            self.copy_into(out.slice(axis, at, at + view.shape[axis]), view)
            at += view.shape[axis]
        return out

    def matmul(self, a: View, b: View, bias: View | None = None) -> View:
        """Matrix product of two-dimensional views, plus a bias that broadcasts to the result."""
        shape = (a.shape[0], b.shape[1])
        if a.is_constant and b.is_constant and (bias is None or bias.is_constant):
            self.room(shape)
            product: Values = a.numpy() @ b.numpy()
            return self.constant(product if bias is None else product + bias.numpy())
        out = self.local(shape, a.kind)
        self.product_into(out, a, b, bias)
        return out

    def product_into(self, out: View, a: View, b: View, bias: View | None = None) -> None:
        """Assign a matrix product to a two-dimensional view.

        Constant weights of a single row times a matrix are stored neuron by neuron, in the order they are read.
        """
        if a.shape[0] == 1 and b.is_constant and b.size > max(b.shape) and b.strides != (1, b.shape[0]):
            flat = np.ascontiguousarray(b.numpy().T, dtype=np.float64).reshape(-1)
            stored = Buffer(self.names.unique(b.buffer.name), flat.size, "constant", flat)
            b = whole(stored, b.shape[::-1], b.kind).transpose((1, 0))
        self.statements.append(MatMul(out, a, b, None if bias is None else bias.expand(out.shape), self.note))

    def reduce(self, function: Reduction, view: View, axes: Sequence[int], keep: bool) -> View:
        """Sum, greatest or least element over some axes, which stay with length 1 where ``keep``."""
        kept = [axis for axis in range(len(view.shape)) if axis not in axes]
        shape = [1 if axis in axes else n for axis, n in enumerate(view.shape)]
        if view.is_constant:
            reduced = {"sum": np.add, "max": np.maximum, "min": np.minimum}[function].reduce
            out = self.constant(reduced(view.numpy(), axis=tuple(axes)))
        else:
            out = self.local([view.shape[axis] for axis in kept], view.kind)
            self.statements.append(Reduce(function, out, view.transpose([*kept, *axes]), self.note))
        return self.reshape(out, shape) if keep else out

    def table(self, view: View, index: NDArray[np.int64]) -> View:
        """Elements of ``view`` at positions of its row-major order; the result has the shape of ``index``."""
        if view.is_constant:
            return self.constant(view.numpy().reshape(-1)[index])
        source = self.reshape(view, (view.size,))
        out = self.local(index.shape, view.kind)
        flat = out.reshape((out.size,))
        assert flat is not None
        self.statements.append(Gather(flat, source, index.reshape(-1), self.note))
        return out

    def finish(self, inputs: Sequence[Port], outputs: Sequence[tuple[str, View]]) -> Program:
        """Copy the results to output arguments and close the program."""
        ports = []
        for label, view in outputs:
            self.note = f"output {label}"
            out = whole(Buffer(self.names.unique("out_" + label), view.size, "output"), view.shape, view.kind)
            self.copy_into(out, view)
            ports.append(Port(label, out))
        return Program(tuple(inputs), tuple(ports), _used(self.statements, {port.view.buffer for port in ports}))


def _kind_of(function: str, operands: Sequence[View]) -> Kind:
    fixed = FUNCTIONS[function].kind
    if fixed:
        return fixed
    kinds = {view.kind for view in (operands[1:] if function == "select" else operands)}
    return "float" if "float" in kinds else "int" if "int" in kinds else "bool"


def _used(statements: Sequence[Statement], wanted: set[Buffer]) -> tuple[Statement, ...]:
    """Only what contributes to the wanted buffers, in the same order."""
    kept = []
    for statement in reversed(statements):
        if statement.out.buffer in wanted and statement.out.size:
            kept.append(statement)
            wanted.update(view.buffer for view in statement.operands)
    return tuple(reversed(kept))
