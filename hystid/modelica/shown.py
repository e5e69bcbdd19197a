"""What the outputs of a model need: for models whose inner states are known without their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

from hystid.modelica.blocks import Step, sources, targets
from hystid.modelica.hybrid import HybridModel, is_output


@dataclass(frozen=True)
class Shown:
    """Steps that give the outputs from states, inputs and parameters, and the algebraic variables that they give."""

    steps: tuple[Step, ...]
    variables: tuple[str, ...]


def shown_of(model: HybridModel) -> Shown | None:
    """The steps behind the outputs; None where they need modes of the model, or everything."""
    needed = {model.aliases.get(name, name) for name, v in model.variables.items() if is_output(name, v)}
    steps: list[Step] = []
    for step in reversed(model.derivatives):
        if needed & {*targets(step)}:
            needed |= sources(step)
            steps.insert(0, step)
    modes = {*model.discrete, *(relation.name for relation in model.relations)}
    if needed & modes or len(steps) == len(model.derivatives):
        return None
    return Shown(tuple(steps), tuple(name for name in model.algebraic if name in needed))
