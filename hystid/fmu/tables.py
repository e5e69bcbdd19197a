"""C tables that tell the shell what each slot of the value block is to an importer."""

from __future__ import annotations

import math

from hystid.fmu.interface import Interface
from hystid.modelcode import Variable


def variables_source(model: Interface, version: int) -> str:
    """Text of ``hy_variables.c``. version: of FMI; in FMI 2.0 enumerations are read and set as Integers."""
    count = max(model.code.n_values, 1)
    rows = [
        f"    [{slot}] = {{{_type(group[0], version)}, {_flags(group)}, {_size(model, slot)}, "
        f'"{_escaped(group[0].name)}", {", ".join(map(_bound, _limits(group)))}}},'
        for slot, group in sorted(model.groups.items())
    ]
    nominals = [abs(model.named(name).nominal or 1.0) for name in model.code.states] or [1.0]
    texts = [f'"{_escaped(text.content)}"' for text in model.code.texts] or ["0"]
    return "\n".join(
        (
            "/* The model's variables as FMI sees them, by slot of the value block. */",
            '#include "hy_fmi.h"',
            "",
            "#include <math.h>",
            "",
            f"const hy_variable hy_variables[{count}] = {{",
            *rows,
            "};",
            "",
            f"const double hy_nominals[] = {{{', '.join(map(repr, nominals))}}};",
            "",
            f"const int hy_n_texts = {len(model.code.texts)}, hy_has_arrays = {int(bool(model.arrays))};",
            f"const char *const hy_texts[] = {{{', '.join(texts)}}};",
            "",
        )
    )


def _type(v: Variable, version: int) -> str:
    return "ENUMERATION" if v.enumeration and version == 3 else v.type.upper()


def _size(model: Interface, slot: int) -> int:
    if model.first_slots[slot] != slot:
        return 0
    return len(model.arrays[slot].elements) if slot in model.arrays else 1


def _limits(group: tuple[Variable, ...]) -> tuple[float, float]:
    """Least and greatest value of a parameter: what an importer sets is held to them. Inputs come from solvers, whose
    trial steps may overshoot, and from masters that begin with 0."""
    held = [v for v in group if v.causality in ("parameter", "structuralParameter")]
    low = max((v.min for v in held if v.min is not None), default=-math.inf)
    high = min((v.max for v in held if v.max is not None), default=math.inf)
    return low, high


def _bound(value: float) -> str:
    return {-math.inf: "-INFINITY", math.inf: "INFINITY"}.get(value, repr(float(value)))


def _flags(group: tuple[Variable, ...]) -> str:
    flags = {flag for variable in group for flag in _flags_of(variable)}
    if any(map(math.isfinite, _limits(group))):
        flags.add("HAS_LIMITS")
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
