"""Rigs that turn: the same equations in other words and units.

x is an angle then, F and R are torques, and m is an inertia. Models, laws and fits know nothing of it. What is shown or
written of a rig that turns goes through here.

The functions change what they do not know as turned, and leave the rest: applying them twice is the same as once.
"""

from __future__ import annotations

import hashlib
import re
import uuid
from dataclasses import replace
from functools import partial

from hystid.modelcode import ModelCode

_UNIT = re.compile(r"([kMGmµn]?)(N|m)([0-9²³]?)|(kg)")
_MEASURED = re.compile(
    r"(?<=[0-9)] )((?:[kMGmµn]?[Nm][0-9²³]?|kg)(?:[./·](?:N|m|s|kg|rad|Hz)[0-9²³]?)*)(?![\w²³]|[./]\w)"
)
_WORDS = (
    (r"an? displacement", "an angle"), (r"displacements", "angles"), (r"displacement", "angle"),
    (r"forces", "torques"), (r"force", "torque"), (r"a mass", "an inertia"), (r"masses", "inertias"),
    (r"mass", "inertia"), (r"a velocity", "an angular velocity"), (r"(?<!angular )velocity", "angular velocity"),
    (r"an? acceleration", "an angular acceleration"), (r"(?<!angular )acceleration", "angular acceleration"),
)  # fmt: skip
_BRACKETED = re.compile(r"(?<=\[)[^\[\] ]+(?=\])")
# Not within names of files, options and variables.
_PATTERNS = [(re.compile(rf"(?<![\w./\-]){old}(?![\w/\-]|\.\w)", re.I), new) for old, new in _WORDS]


def turned_unit(unit: str) -> str:
    """The unit of a quantity of a rig that turns: "N.s/m" is "N.m.s/rad", "kg" is "kg.m2", "mm" is "mrad"."""
    parts = re.split(r"([./()·])", unit)
    for k, atom in enumerate(parts):
        found = _UNIT.fullmatch(atom)
        before = parts[k - 2] if k > 1 and parts[k - 1] == "." else ""
        if not found or (found[2] == "m" and (before.endswith("N") or before == "kg")):
            continue  # "N.m" and "kg.m2" are turned already
        after = parts[k + 2] if k + 2 < len(parts) and parts[k + 1] == "." else ""
        if found[4]:
            parts[k] = "kg" if after == "m2" else "kg.m2"
        elif found[2] == "m":
            parts[k] = f"{found[1]}rad{found[3]}"
        elif after != "m":
            torque = f"{found[1]}N.m"
            below = k > 0 and parts[k - 1] == "/"
            parts[k] = f"({torque}){found[3]}" if found[3] or below else torque
    return "".join(parts)


def turned_text(text: str) -> str:
    """A text about a rig that turns: an angle where a displacement was, a torque where a force was, and their units.

    >>> turned_text("Restoring force of 5 N at a displacement of 2 mm")
    'Restoring torque of 5 N.m at an angle of 2 mrad'
    """
    for pattern, new in _PATTERNS:
        text = pattern.sub(partial(_in_case, new), text)
    text = _BRACKETED.sub(lambda found: turned_unit(found[0]), text)
    return _MEASURED.sub(lambda found: turned_unit(found[1]), text)


def _in_case(new: str, old: re.Match[str]) -> str:
    return new[0].upper() + new[1:] if old[0][0].isupper() else new


def turned_code(code: ModelCode) -> ModelCode:
    """A model whose variables are those of a rig that turns; its numbers and its equations stay."""
    variables = tuple(
        replace(v, unit=turned_unit(v.unit), description=turned_text(v.description)) for v in code.variables
    )
    described = replace(code, variables=variables, description=turned_text(code.description))
    if not code.token:
        return described
    # another interface has another token, in the text as well
    token = "{" + str(uuid.UUID(bytes=hashlib.sha256(f"turned {code.token}".encode()).digest()[:16])) + "}"
    sources = {name: text.replace(code.token, token) for name, text in code.sources.items()}
    return replace(described, token=token, sources=sources)
