"""Which variables the front end's dictionary speaks of, and how."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from typing import Any

_NESTED = frozenset((dict, list))


def unconnected(d: Mapping[str, Any]) -> set[str]:
    """Variables of expandable connectors that nothing speaks of: they are not there (specification, section 9.1.3)."""
    offered = {v["name"] for v in d["variables"].values() if v["from_expandable_connector"]}
    if not offered:
        return set()
    bindings = [v["binding"] for v in d["variables"].values()]
    spoken = [bindings, *(d[k] for k in ("equations", "initial_equations", "when_chains", "assert_equations"))]
    named = {name.partition("[")[0] if name not in offered else name for name in _variable_names(spoken)}
    assigned = {a["Assign"]["target"] for a in dictionaries(d["when_chains"]) if "Assign" in a}
    return offered - named - assigned


def structural_names(d: Mapping[str, Any], deciding: Set[str]) -> frozenset[str]:
    """Parameters whose values decided sizes, loops or what exists, and those that these are bound to.

    The front end tells those of equations and of variables, each as a list of names, the qualified one first. Of
    components it tells nothing: they are found by their last names, ``deciding``.
    """
    found = {
        r[0] if isinstance(r, list) else r for s in d.get("parameter_branch_selections", ()) for r in s["references"]
    }
    found |= {n for n in d["variables"] if n.rpartition(".")[2].partition("[")[0] in deciding}
    while True:
        bindings = (d["variables"][n]["binding"] for n in found if n in d["variables"])
        more = {n for b in bindings if b is not None for n in _variable_names(b)} & set(d["variables"])
        if more <= found:
            return frozenset(found)
        found |= more


def _variable_names(node: Any) -> Iterator[str]:
    for name in (d["VarRef"]["name"] for d in dictionaries(node) if "VarRef" in d):
        yield name["name"] if isinstance(name, dict) else name


def spans(node: Any) -> Iterator[Mapping[str, Any]]:
    """Dictionaries with a span, outermost first."""
    return (d for d in dictionaries(node) if isinstance(d.get("span"), dict))


def dictionaries(node: Any) -> Iterator[dict[str, Any]]:
    """All dictionaries within, outer ones before inner ones, in the order of the text."""
    stack = [node]
    while stack:
        node = inside = stack.pop()
        if type(node) is dict:
            yield node
            inside = node.values()
        stack.extend(reversed([value for value in inside if type(value) in _NESTED]))
