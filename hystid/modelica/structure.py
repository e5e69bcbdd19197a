"""What is wrong with a model whose equations do not each determine one unknown, in the names of its author.

The equations from which a matching cannot be completed, and the unknowns that it does not reach, mark two parts of the
model (Dulmage and Mendelsohn 1958): one with more equations than unknowns, one with fewer. The rest is sound.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hystid.errors import ModelicaError
from hystid.modelica.check import equation_text
from hystid.modelica.expr import op
from hystid.modelica.scalar import ScalarEquation

_SHOWN_NAMES = 4  # equations or names, before "and more" stands for the others


@dataclass(frozen=True)
class Incidence:
    """Which unknowns an equation speaks of, and how far a matching came.

    options: for each equation its unknowns; owner: unknown -> the equation that determines it; left: equations that
    determine nothing; unmatched: unknowns that nothing determines.
    """

    equations: Sequence[ScalarEquation]
    options: Sequence[Sequence[str]]
    owner: Mapping[str, int]
    left: Sequence[int]
    unmatched: Sequence[str]


def structural_error(found: Incidence, model: str) -> ModelicaError:
    """The error for what is over- and what is underdetermined. model: where it stands, if no equation tells."""
    over, tied = _overdetermined(found)
    rest, loose = _underdetermined(found)
    said = []
    if over:
        said.append(
            f"{_count(len(over), 'equation')} for {_count(len(tied), 'unknown')}"
            f"{f' ({_names(tied)})' if tied else ''}, {len(over) - len(tied)} too many: {_texts(found, over)}"
        )
    if loose:
        said.append(
            f"{_count(len(rest), 'equation')} for {_count(len(loose), 'unknown')} ({_names(loose)}), "
            f"{len(loose) - len(rest)} too few{f': {_texts(found, rest)}' if rest else ''}"
        )
    first = [*found.left, *rest]
    place = str(found.equations[first[0]].place) if first else model
    return ModelicaError(f"{place}: the model is structurally singular: {'; '.join(said)}")


def _overdetermined(found: Incidence) -> tuple[list[int], list[str]]:
    """Equations reached from those that are left, and the unknowns that they all speak of."""
    unknowns: dict[str, None] = {}
    equations, waiting = set(found.left), list(found.left)
    while waiting:
        for name in found.options[waiting.pop()]:
            unknowns[name] = None
            if found.owner[name] not in equations:
                equations.add(found.owner[name])
                waiting.append(found.owner[name])
    return sorted(equations), list(unknowns)


def _underdetermined(found: Incidence) -> tuple[list[int], list[str]]:
    """Unknowns reached from those that nothing determines, and the equations that speak of them."""
    speak: dict[str, list[int]] = defaultdict(list)
    for k, names in enumerate(found.options):
        for name in names:
            speak[name].append(k)
    determined = {k: name for name, k in found.owner.items()}
    equations: set[int] = set()
    unknowns, waiting = dict.fromkeys(found.unmatched), list(found.unmatched)
    while waiting:
        for k in speak[waiting.pop()]:
            equations.add(k)
            if determined[k] not in unknowns:
                unknowns[determined[k]] = None
                waiting.append(determined[k])
    return sorted(equations), list(unknowns)


def _count(n: int, word: str) -> str:
    return f"{n or 'no'} {word}{'' if n == 1 else 's'}"


def _names(names: Sequence[str]) -> str:
    return ", ".join(names[:_SHOWN_NAMES]) + (" and more" if len(names) > _SHOWN_NAMES else "")


def _texts(found: Incidence, which: Sequence[int]) -> str:
    fewest = sorted(which, key=lambda k: len(found.options[k]))[:_SHOWN_NAMES]  # these tell most
    shown = [found.equations[k] for k in sorted(fewest)]
    texts = [f"'{equation_text(op('-', e.left, e.right))}' ({e.place.short})" for e in shown]
    return ", ".join(texts) + (" and more" if len(which) > _SHOWN_NAMES else "")
