"""The diagnosed model as readable Modelica: the baseline, extended by the named effects with their fitted values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite

from hystid.diagnosis.fitting import Term
from hystid.diagnosis.result import Value

CLASS = "Extended"


def extended_model(
    baseline: str,
    refit: Mapping[str, Value],
    terms: Sequence[tuple[Term, Mapping[str, Value]]],
    remarks: Sequence[str] = (),
    own: Mapping[str, str] | None = None,
) -> str:
    """Text of a Modelica class that extends the baseline.

    refit: baseline parameters. terms: effects with their values and standard errors. remarks: sentences for the
    head, such
    as faults of the recording, which are no part of a model. own: texts of the user's blocks by class name.
    """
    names = _instance_names([term for term, _ in terms])
    sums = " + ".join(f"{name}.f" for name in names)
    changes = [f"{name} = {_number(value.value)}" for name, value in refit.items()]
    changes += [f"f_effects = {sums}"] if names else []
    lines = [*(f"// {remark}" for remark in remarks), f'model {CLASS} "{_title(baseline, terms)}"']
    lines += [f"  extends {_class(baseline)}(", *_joined(changes, "    "), "  );"]
    lines += [f"  // {name}: {_with_error(value)}" for name, value in refit.items()]
    for name, (term, values) in zip(names, terms, strict=True):
        settings = [f"{key} = {_number(value.value)}" for key, value in values.items()]
        lines += [f"  {_class(term.effect.class_name)} {name}(", *_joined(settings, "    "), "  );"]
        lines += [f"  // {name}.{key}: {_with_error(value)}" for key, value in values.items()]
    if names:
        lines.append("equation")
        lines += [f"  {name}.{port} = {own_name};" for name in names for port, own_name in _PORTS]
    blocks = [text.strip() for text in (own or {}).values()]
    return "\n".join([*lines, f"end {CLASS};", *blocks]) + "\n"


_PORTS = (("x", "x"), ("v", "v"), ("a", "a"), ("h", "f_h"))


def _title(baseline: str, terms: Sequence[tuple[Term, Mapping[str, Value]]]) -> str:
    found = " and ".join(term.effect.id.replace("_", " ") for term, _ in terms)
    return f"{_class(baseline).rpartition('.')[2]} oscillator as fitted" + (f", with {found}" if found else "")


def _class(name: str) -> str:
    return name.rpartition(":")[2]


def _instance_names(terms: Sequence[Term]) -> list[str]:
    names: list[str] = []
    for term in terms:
        first, *rest = term.effect.id.split("_")
        base = first + "".join(word.capitalize() for word in rest)
        name, k = base, 2
        while name in names:
            name, k = f"{base}{k}", k + 1
        names.append(name)
    return names


def _joined(settings: Sequence[str], indent: str) -> list[str]:
    return [f"{indent}{text}{',' if i < len(settings) - 1 else ''}" for i, text in enumerate(settings)]


def _number(value: float) -> str:
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e6 else f"{value:.9g}"


def _with_error(value: Value) -> str:
    error = f"standard error {value.stderr:.2g}" if isfinite(value.stderr) and value.stderr > 0 else "not fitted"
    return f"{value.value:.6g} {value.unit}".strip() + f", {error}"
