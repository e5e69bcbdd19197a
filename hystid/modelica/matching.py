"""Which equation determines which unknown."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterable, Sequence, Set
from typing import TypeVar

Unknown = TypeVar("Unknown", bound=Hashable)


def matching(
    candidates: Sequence[Sequence[Unknown]], unknowns: Iterable[Unknown]
) -> tuple[dict[Unknown, int], list[int]]:
    """Largest assignment of one unknown to each equation.

    candidates: for each equation the unknowns that it may determine, most wanted first.
    Returns unknown -> equation and the equations that got none. The first choices are taken where they are free, then
    augmenting paths (breadth first) make room.
    """
    owner: dict[Unknown, int] = {}
    known = set(unknowns)
    waiting = []
    for equation, options in enumerate(candidates):
        first = next((u for u in options if u in known and u not in owner), None)
        if first is None:
            waiting.append(equation)
        else:
            owner[first] = equation
    left = [e for e in waiting if not augment(e, candidates, known, owner)]
    return owner, left


def augment(
    equation: int, candidates: Sequence[Sequence[Unknown]], known: Set[Unknown], owner: dict[Unknown, int]
) -> bool:
    """Give ``equation`` an unknown by moving others along an augmenting path; False where there is none."""
    parent: dict[Unknown, int] = {}
    owned: dict[int, Unknown] = {}  # by equations in the queue
    queue = deque([equation])
    while queue:
        e = queue.popleft()
        for u in candidates[e]:
            if u not in known or u in parent:
                continue
            parent[u] = e
            if u not in owner:
                owner[u] = parent[u]
                while owner[u] != equation:
                    u = owned[owner[u]]
                    owner[u] = parent[u]
                return True
            owned[owner[u]] = u
            queue.append(owner[u])
    return False
