"""C tables that tell the shell what each slot of the value block is to an importer."""

from __future__ import annotations

from hystid.fmu.interface import Interface
from hystid.modelcode import Variable

_TYPES = {"Real": "REAL", "Integer": "INTEGER", "Boolean": "BOOLEAN"}


def variables_source(model: Interface) -> str:
    """Text of ``hy_variables.c``."""
    count = max(model.code.n_values, 1)
    rows = [
        f'    [{slot}] = {{{_TYPES[group[0].type]}, {_flags(group)}, "{_escaped(group[0].name)}"}},'
        for slot, group in sorted(model.groups.items())
    ]
    nominals = [abs(model.named(name).nominal or 1.0) for name in model.code.states] or [1.0]
    return "\n".join(
        (
            "/* The model's variables as FMI sees them, by slot of the value block. */",
            '#include "hy_fmi.h"',
            "",
            f"const hy_variable hy_variables[{count}] = {{",
            *rows,
            "};",
            "",
            f"const double hy_nominals[] = {{{', '.join(map(repr, nominals))}}};",
            "",
        )
    )


def _flags(group: tuple[Variable, ...]) -> str:
    flags = {flag for variable in group for flag in _flags_of(variable)}
    return " | ".join(sorted(flags)) or "0"


def _flags_of(v: Variable) -> list[str]:
    flags = []
    if v.start is not None and v.variability != "constant" and v.causality != "independent":
        flags.append("HAS_START")
    if v.causality == "input":
        flags.append("IS_INPUT")
        if v.variability == "discrete":
            flags.append("IS_DISCRETE")
    if v.causality == "output":
        flags.append("IS_OUTPUT")
    if v.causality == "parameter" and v.variability == "tunable":
        flags.append("IS_TUNABLE")
    return flags


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ").replace("?", "\\?")
