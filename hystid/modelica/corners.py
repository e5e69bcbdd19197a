"""Which corners of ``smooth(0, ...)`` and ``noEvent`` make events: those of loops that are linear between them.

A loop such as that of an operational amplifier with feedback may have several answers, and jumps from one to another. A
solver that tries a step and takes it back would jump without a reason; with events the loop stays on its piece until
the end of the piece is reached. Elsewhere such corners make no event (specification 3.6, section 3.7.5).
Nothing that ``noEvent`` would guard, as a root, is linear.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence, Set

from hystid.modelica.blocks import Solve, Step, has_steps
from hystid.modelica.differentiation import Derivative
from hystid.modelica.event_model import EventModel
from hystid.modelica.events import is_cornered, mark_corners
from hystid.modelica.expr import RELATIONS, Expr, Num, Op, Ref, nodes, rebuild, refs
from hystid.modelica.scalar import ScalarModel


def corners_in_loops(scalar: ScalarModel, steps_of: Callable[[EventModel], Sequence[Step]]) -> frozenset[Expr]:
    """Relations for ``name_events``. steps_of: the order of evaluation between events."""
    running = {n for n, v in scalar.variables.items() if v.kind == "unknown"}
    if not any(_corners(side, running) for e in scalar.equations for side in (e.left, e.right)):
        return frozenset()
    events, marked = mark_corners(scalar)
    found = (k for step in steps_of(events) if isinstance(step, Solve) for k in _in_loop(step))
    return frozenset(marked[k] for k in found)


def _corners(expr: Expr, running: Set[str]) -> bool:
    """Whether there are corners that may lie in a loop: of more than time and parameters."""
    parts = (n for n in nodes(expr) if isinstance(n, Op) and is_cornered(n))
    inside = (n for part in parts for n in nodes(part) if isinstance(n, Op) and n.name in RELATIONS)
    return any(refs(relation) & running for relation in inside)


def _in_loop(step: Solve) -> Iterator[int]:
    """Numbers of the corners of a loop that is linear where they are held."""
    inside = frozenset(step.variables)
    numbers: set[int] = set()

    def held(node: Expr) -> Expr | None:
        if isinstance(node, Op) and node.name == "corner" and refs(node) & inside:
            assert isinstance(node.args[1], Num)
            numbers.add(int(node.args[1].value))
            return Ref(f"$corner{node.args[1].value:g}")
        return None

    residuals = [rebuild(r, held) for r in step.residuals]
    slopes = (Derivative(name)(r) for r in residuals for name in step.variables)
    if not any(refs(slope) & inside for slope in slopes) and not any(has_steps(r, inside) for r in residuals):
        yield from numbers
