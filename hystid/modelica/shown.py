"""What the outputs of a model need: for samples at which the states are known without their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

from hystid.modelica.blocks import Assign, sources, targets
from hystid.modelica.event_model import pre
from hystid.modelica.hybrid import HybridModel, is_output


@dataclass(frozen=True)
class Shown:
    """Steps that give the outputs from time, states, inputs and parameters, and the algebraic variables that they
    give."""

    steps: tuple[Assign, ...]
    variables: tuple[str, ...]


def shown_of(model: HybridModel) -> Shown | None:
    """The steps behind the outputs; None where they need modes of the model, or simultaneous equations."""
    needed = {model.aliases.get(name, name) for name, v in model.variables.items() if is_output(name, v)}
    steps: list[Assign] = []
    for step in reversed(model.derivatives):
        if needed & {*targets(step)}:
            if not isinstance(step, Assign):
                return None
            needed |= sources(step)
            steps.insert(0, step)
    modes = {*model.discrete, *map(pre, model.discrete), *(relation.name for relation in model.relations)}
    if needed & modes or model.delays:
        return None
    return Shown(tuple(steps), tuple(name for name in model.algebraic if name in needed))
