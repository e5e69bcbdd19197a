"""Which variables the front end's dictionary speaks of, and how."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def unconnected(d: Mapping[str, Any]) -> set[str]:
    """Variables of expandable connectors that nothing speaks of: they are not there (specification, section 9.1.3)."""
    offered = {v["name"] for v in d["variables"].values() if v["from_expandable_connector"]}
    if not offered:
        return set()
    bindings = [v["binding"] for v in d["variables"].values()]
    spoken = [bindings, *(d[k] for k in ("equations", "initial_equations", "when_chains", "assert_equations"))]
    named = {name.partition("[")[0] if name not in offered else name for name in _variable_names(spoken)}
    assigned = {a["target"] for c in d["when_chains"] for a in _assignments(c)}
    return offered - named - assigned


def _assignments(node: Any) -> Iterator[Mapping[str, Any]]:
    if isinstance(node, dict):
        if "Assign" in node:
            yield node["Assign"]
        for value in node.values():
            yield from _assignments(value)
    elif isinstance(node, list):
        for value in node:
            yield from _assignments(value)


def structural_names(d: Mapping[str, Any]) -> frozenset[str]:
    """Parameters whose values decided sizes, loops or which equations exist, and those that these are bound to.

    The front end gives each as a list of names, the qualified one first.
    """
    found = {
        r[0] if isinstance(r, list) else r for s in d.get("parameter_branch_selections", ()) for r in s["references"]
    }
    while True:
        bindings = (d["variables"][n]["binding"] for n in found if n in d["variables"])
        more = {n for b in bindings if b is not None for n in _variable_names(b)} & set(d["variables"])
        if more <= found:
            return frozenset(found)
        found |= more


def _variable_names(node: Any) -> Iterator[str]:
    if isinstance(node, dict):
        if "VarRef" in node:
            name = node["VarRef"]["name"]
            yield name["name"] if isinstance(name, dict) else name
        for value in node.values():
            yield from _variable_names(value)
    elif isinstance(node, list):
        for value in node:
            yield from _variable_names(value)
