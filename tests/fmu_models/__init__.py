"""Hand-written models of the value block: what the shell can do is tested without any compiler of ours."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Literal

from hystid.fmu.build import build
from hystid.fmu.door import OpenedFmu, open_fmu
from hystid.modelcode import Experiment, ModelCode, Variable

FOLDER = Path(__file__).parent
_FOLDER = tempfile.TemporaryDirectory(prefix="hystid-test-fmus-")


def _parameter(name: str, slot: int, start: float, unit: str = "") -> Variable:
    return Variable(
        name, slot, "parameter", "fixed", initial="exact", start=start, unit=unit, description=f"{name} of the model"
    )


def _input(name: str, slot: int, unit: str = "") -> Variable:
    return Variable(name, slot, "input", "continuous", start=0.0, unit=unit)


def _state(name: str, slot: int, unit: str = "", start: float = 0.0) -> Variable:
    return Variable(name, slot, "output", "continuous", initial="exact", start=start, unit=unit)


def _der(name: str, slot: int, unit: str = "") -> Variable:
    return Variable(f"der({name})", slot, "local", "continuous", initial="calculated", unit=unit, derivative_of=name)


def _output(name: str, slot: int, unit: str = "") -> Variable:
    return Variable(name, slot, "output", "continuous", initial="calculated", unit=unit)


def _discrete(name: str, slot: int) -> Variable:
    return Variable(name, slot, "output", "discrete", initial="exact", start=0.0)


def _code(name: str, variables: list[Variable], n_values: int, **more: object) -> ModelCode:
    text = (FOLDER / f"{name.lower()}.c").read_text()
    return ModelCode(
        name, f"{name} for tests", tuple(variables), {"model.c": text}, n_values=n_values, token=name.lower(), **more
    )  # type: ignore[arg-type]


def jenkins() -> ModelCode:
    variables = [
        _parameter("m", 1, 1.0, "kg"),
        _parameter("B", 2, 5.0, "N.s/m"),
        _parameter("Kl", 3, 4e4, "N/m"),
        _parameter("Ks", 4, 2e4, "N/m"),
        _parameter("fc", 5, 20.0, "N"),
        _input("F", 6, "N"),
        _state("x", 7, "m"),
        _state("v", 8, "m/s"),
        _state("z", 9, "N"),
        _der("x", 10, "m/s"),
        _der("v", 11, "m/s2"),
        _der("z", 12, "N/s"),
        _output("a", 13, "m/s2"),
        _output("R", 14, "N"),
    ]
    return _code(
        "Jenkins",
        variables,
        15,
        states=("x", "v", "z"),
        has_forward=True,
        experiment=Experiment(0, 0.5, 1e-4),
        dependencies={
            "x": ("x",),
            "v": ("v",),
            "z": ("z",),
            "der(x)": ("v",),
            "der(v)": ("F", "x", "v", "z"),
            "der(z)": ("v", "z"),
            "a": ("F", "x", "v", "z"),
            "R": ("x", "v", "z"),
        },
    )


def bouncing() -> ModelCode:
    variables = [
        _parameter("g", 1, 9.81, "m/s2"),
        _parameter("e", 2, 0.7),
        _state("x", 3, "m", 1.0),
        _state("v", 4, "m/s"),
        _der("x", 5, "m/s"),
        _der("v", 6, "m/s2"),
        _discrete("count", 7),
    ]
    return _code(
        "Bouncing",
        variables,
        10,
        states=("x", "v"),
        n_indicators=1,
        experiment=Experiment(0, 1.5, 1e-3),
        dependencies={"x": ("x",), "v": ("v",), "der(x)": ("v",), "der(v)": (), "count": ()},
    )


def sampled() -> ModelCode:
    variables = [
        _parameter("Ts", 1, 0.1, "s"),
        _parameter("tau", 2, 0.05, "s"),
        _input("u", 3),
        _state("y", 4),
        _der("y", 5, "1/s"),
        _discrete("count", 6),
        _discrete("u_s", 7),
    ]
    return _code(
        "Sampled",
        variables,
        11,
        states=("y",),
        experiment=Experiment(0, 1.0, 1e-3),
        dependencies={"y": ("y",), "der(y)": ("y",), "count": (), "u_s": ("u",)},
    )


def linear() -> ModelCode:
    variables = [
        _parameter("m", 1, 2.0, "kg"),
        _parameter("b", 2, 4.0, "N.s/m"),
        _parameter("k", 3, 800.0, "N/m"),
        _input("F", 4, "N"),
        _state("x", 5, "m"),
        _state("v", 6, "m/s"),
        _der("x", 7, "m/s"),
        _der("v", 8, "m/s2"),
        _output("R", 9, "N"),
    ]
    return _code(
        "Linear",
        variables,
        10,
        states=("x", "v"),
        has_forward=True,
        has_adjoint=True,
        experiment=Experiment(0, 1.0, 1e-3),
        dependencies={"x": ("x",), "v": ("v",), "der(x)": ("v",), "der(v)": ("F", "x", "v"), "R": ("x", "v")},
    )


def effect() -> ModelCode:
    variables = [
        _parameter("k3", 1, 1e6, "N/m3"),
        _parameter("b2", 2, 3.0, "N.s2/m2"),
        _input("x", 3, "m"),
        _input("v", 4, "m/s"),
        _input("a", 5, "m/s2"),
        _input("h", 6, "N"),
        _output("f", 7, "N"),
    ]
    return _code("Effect", variables, 8, has_forward=True, dependencies={"f": ("x", "v")})


def contact() -> ModelCode:
    variables = [
        _parameter("m", 1, 1.0, "kg"),
        _parameter("k", 2, 100.0, "N/m"),
        _parameter("ks", 3, 1e4, "N/m"),
        _parameter("gap", 4, 0.5, "m"),
        _input("F", 5, "N"),
        _state("x", 6, "m"),
        _state("v", 7, "m/s", 10.0),
        _der("x", 8, "m/s"),
        _der("v", 9, "m/s2"),
        _output("R", 10, "N"),
    ]
    return _code(
        "Contact",
        variables,
        12,
        states=("x", "v"),
        n_indicators=1,
        experiment=Experiment(0, 1.0, 1e-3),
        dependencies={"x": ("x",), "v": ("v",), "der(x)": ("v",), "der(v)": ("F", "x"), "R": ("x",)},
    )


def memory() -> ModelCode:
    variables = [
        _parameter("k", 1, 100.0, "N/m"),
        _parameter("c", 2, 7.0, "N/m"),
        _input("x", 3, "m"),
        _input("v", 4, "m/s"),
        _output("R", 7, "N"),
    ]
    return _code("Memory", variables, 10, dependencies={"R": ("x", "v")}, has_memory=True, sample=1e-4)


def tuned() -> ModelCode:
    variables = [
        _parameter("rate", 1, 2.0),
        Variable("gain", 2, "parameter", "tunable", initial="exact", start=3.0),
        Variable("product", 3, "calculatedParameter", "tunable", initial="calculated"),
        Variable("level", 4, "input", "discrete", "Integer", start=0.0),
        _output("y", 5),
    ]
    return _code("Tuned", variables, 6, dependencies={"y": ("level",)})


EVERY = (jenkins, bouncing, sampled, linear, effect, contact, memory, tuned)


@cache
def built(make: Callable[[], ModelCode], version: Literal[2, 3]) -> Path:
    """An FMU of a model, built once per process."""
    path = Path(_FOLDER.name) / f"{make.__name__}{version}.fmu"
    return build(make(), path, fmi=version).path


@cache
def unpacked(make: Callable[[], ModelCode], version: Literal[2, 3]) -> OpenedFmu:
    """The same, unpacked."""
    return open_fmu(built(make, version))
