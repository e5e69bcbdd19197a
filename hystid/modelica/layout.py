"""Where each variable lies in the value block of ``hy_model.h``."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

from hystid.modelica.delays import slots
from hystid.modelica.event_model import BEGIN, HOMOTOPY, INITIAL, der, pre
from hystid.modelica.expr import refs
from hystid.modelica.hybrid import HybridModel

MANY = "$many"  # 1 once it was told that a loop has many solutions
LIMIT = "$limit"  # argument beyond which exponentials in loops are straight lines; 0 for none


@dataclass(frozen=True)
class Layout:
    """Slots of a model.

    w: the flag of initialisation, when the run began, how far homotopy has come, whether many solutions were told, a
    limit of exponentials, the next tick of each sampler, which warnings were given, what delays keep.
    """

    model: HybridModel

    @cached_property
    def sections(self) -> dict[str, tuple[int, int]]:
        """Section name of ``hy_model.h`` -> (first slot, number of slots)."""
        found, at = {}, 1
        for name, items in self._items().items():
            found[name] = (at, len(items))
            at += len(items)
        return found

    def _items(self) -> dict[str, list[str]]:
        m = self.model
        return {
            "p": [*m.settable, *m.computed],
            "u": list(m.inputs),
            "x": list(m.states),
            "dx": [der(n) for n in m.states],
            "d": list(m.discrete),
            "y": list(m.algebraic),
            "pre": [pre(n) for n in m.discrete],
            "rel": [r.name for r in m.relations],
            "w": [
                INITIAL,
                *([BEGIN] if any(BEGIN in refs(r.value) for r in m.relations) else []),
                *([HOMOTOPY] if m.homotopy else []),
                *([MANY] if any(s.linear for s in m.loops) else []),
                *([LIMIT] if any(not s.linear for s in m.loops) else []),
                *(tick(s.flag) for s in m.samplers),
                *(warned(k) for k in range(len(m.assertions))),
                *(name for delay, points in m.delays.items() for name in slots(delay, points)),
            ],
        }

    @cached_property
    def slots(self) -> dict[str, int]:
        """Name -> slot, aliases included."""
        names = ["time", *(n for items in self._items().values() for n in items)]
        found = {name: k for k, name in enumerate(names)}
        found |= {alias: found[name] for alias, name in self.model.aliases.items()}
        return found

    @property
    def size(self) -> int:
        """Length of the block."""
        return 1 + sum(count for _, count in self.sections.values())

    def first(self, section: str) -> int:
        """First slot of a section."""
        return self.sections[section][0]

    def count(self, section: str) -> int:
        """Number of slots of a section."""
        return self.sections[section][1]

    def span(self, section: str) -> Iterable[int]:
        """Slots of a section."""
        first, count = self.sections[section]
        return range(first, first + count)


def tick(flag: str) -> str:
    """Name of the number of the next tick of a sampler."""
    return f"tick({flag})"


def warned(number: int) -> str:
    """Name of the mark that the assertion was reported."""
    return f"warned({number})"
