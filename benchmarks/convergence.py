"""Order of convergence of every library oscillator, measured against an integration that shares nothing with it.

Run ``python -m benchmarks.convergence`` for the table of docs/modelica.md. The laws are written again here, in pieces
on which they are smooth: scipy (DOP853, tolerance 1e-12) integrates each piece and finds its end; at an end one sign,
or one slider's mode, changes. The oscillator runs from the library through the generated C with a fixed step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from hystid.compiled import CompiledModel
from hystid.modelica import compile_model

Array = npt.NDArray[np.float64]
Mode = tuple[int, ...]
End = tuple[Callable[[Array], float], int, Callable[[Array], Mode]]  # surface, direction of crossing, next mode
M, B, KL = 1.0, 10.0, 1e4  # kg, N s/m, N/m: the defaults of PartialOscillator
STOP, FINEST, STEPS = 0.2, 2.5e-5, (16, 8, 4, 2)  # s, s, in finest steps
V_START = 0.3  # m/s: no law begins at rest, where sign(v) has no value


def force(t: float | Array) -> Array:
    """Excitation in N."""
    return 60 * np.sin(2 * np.pi * 20 * np.asarray(t))


@dataclass(frozen=True)
class Law:
    """One hysteretic law in pieces.

    force(y, mode) in N and rates(y, mode) of the inner states from y = (x, v, inner states...). ends(mode): the ways in
    which a piece may end. start: mode and number of inner states at the start. expected, reason: order and why.
    """

    force: Callable[[Array, Mode], float]
    rates: Callable[[Array, Mode], Sequence[float]]
    ends: Callable[[Mode], Iterator[End]]
    start: tuple[Mode, int]
    expected: float
    reason: str


def _signs(*surfaces: Callable[[Array, Mode], float]) -> Callable[[Mode], Iterator[End]]:
    """The mode holds the signs of the surfaces; what crosses zero changes its sign, the others are looked at anew."""

    def ends(mode: Mode) -> Iterator[End]:
        for k, surface in enumerate(surfaces):

            def after(y: Array, k: int = k) -> Mode:
                new = list(mode)
                new[k] = -mode[k]
                for j, other in enumerate(surfaces):
                    if j != k:
                        new[j] = int(np.sign(other(y, tuple(new)))) or new[j]
                return tuple(new)

            yield (lambda y, surface=surface: surface(y, mode)), -mode[k], after

    return ends


def _sliders(fc: Sequence[float]) -> Callable[[Mode], Iterator[End]]:
    """Mode of each slider: 0 sticks, 1 and -1 slip in that direction, all together until the motion reverses."""

    def ends(mode: Mode) -> Iterator[End]:
        if any(mode):
            yield (lambda y: y[1]), -next(m for m in mode if m), lambda y: (0,) * len(mode)
        for k, limit in enumerate(fc):
            for side in (1, -1) if not mode[k] else ():
                after = (*mode[:k], side, *mode[k + 1 :])
                yield (lambda y, k=k, b=limit, s=side: s * y[2 + k] - b), 1, lambda y, after=after: after

    return ends


def _x(y: Array, mode: Mode) -> float:
    return float(y[0])


def _v(y: Array, mode: Mode) -> float:
    return float(y[1])


def _z(y: Array, mode: Mode) -> float:
    return float(y[2])


def _pecorari(y: Array, s: Mode) -> float:
    stiffness = 0.5 * 5e3 * (1 - s[0] * s[1])
    return float(stiffness * y[0] + stiffness * 1e-2 * s[0] + 0.5 * 5e3 * 1e-2 * s[0])


def _lugre_rate(y: Array, s: Mode) -> float:
    return float(y[1] - 5e4 * s[0] * y[1] * y[2] / (30 + 7.5 * np.exp(-((y[1] / 0.01) ** 2))))


_IWAN = [2 * 37.5 * i / 72 for i in range(1, 9)]
_KINK = "abs(v) has a kink inside a step"

LAWS = {
    "Linear": Law(lambda y, s: 0.0, lambda y, s: (), lambda s: iter(()), ((), 0), 4, "smooth"),
    "Jenkins": Law(
        lambda y, s: y[2], lambda y, s: [0.0 if s[0] else 5e4 * y[1]], _sliders([37.5]), ((0,), 1), 4,
        "stick and slip are events, located",
    ),
    "Iwan": Law(
        lambda y, s: float(sum(y[2:])), lambda y, s: [0.0 if m else 5e4 / 8 * y[1] for m in s], _sliders(_IWAN),
        ((0,) * 8, 8), 4, "the same for each slider",
    ),
    "BilinearStiffness": Law(
        lambda y, s: (8e3 if s[0] > 0 else 1e4) * y[0], lambda y, s: (), _signs(_x), ((1,), 0), 2,
        "the stiffness changes inside a step (noEvent)",
    ),
    "Dahl": Law(
        lambda y, s: y[2], lambda y, s: [5e4 * (y[1] - s[0] * y[1] * y[2] / 37.5)], _signs(_v), ((1,), 1), 2, _KINK
    ),
    "BoucWen": Law(
        lambda y, s: y[2],
        lambda y, s: [5e4 * y[1] - 1e3 * (0.8 * s[0] * y[1] * y[2] - 1.1 * y[1] * s[1] * y[2])],
        _signs(_v, _z), ((1, 1), 1), 2, "abs(v) and abs(z) have kinks inside a step",
    ),
    "LuGre": Law(
        lambda y, s: 5e4 * y[2] + 10 * _lugre_rate(y, s), lambda y, s: [_lugre_rate(y, s)], _signs(_v), ((1,), 1), 2,
        _KINK,
    ),
    "MicroSlip": Law(
        lambda y, s: 5e3 * y[0] + y[2],
        lambda y, s: [y[1] * (5e4 * (1 - s[0] * y[2] / 37.5) / (1 - 0.5 * s[0] * y[2] / 37.5) - 5e3)],
        _signs(_v), ((1,), 1), 2, "the rate of z has a kink where v = 0",
    ),
    "PecorariSolodov": Law(
        _pecorari, lambda y, s: (), _signs(_v, lambda y, s: float(y[0] + 1e-2 * s[0])), ((1, 1), 0), 1,
        "the force jumps where v = 0, inside a step",
    ),
}  # fmt: skip


def reference(law: Law, times: Array) -> Array:
    """Displacement at the times, in m."""
    mode, inner = law.start
    y = np.array([0.0, V_START, *[0.0] * inner])
    x = np.zeros_like(times)
    t = 0.0
    while t < times[-1] - 1e-14:

        def rates(t: float, y: Array, mode: Mode = mode) -> list[float]:
            return [y[1], (float(force(t)) - B * y[1] - KL * y[0] - law.force(y, mode)) / M, *law.rates(y, mode)]

        ends = list(law.ends(mode))
        events = [_event(surface, direction) for surface, direction, _ in ends]
        solved = solve_ivp(
            rates, (t, times[-1]), y, method="DOP853", rtol=1e-12, atol=1e-15, events=events, dense_output=True
        )
        inside = (times >= t) & (times <= solved.t[-1])
        x[inside] = solved.sol(times[inside])[0]
        t, y = float(solved.t[-1]), solved.y[:, -1]
        mode = next((after(y) for found, (_, _, after) in zip(solved.t_events, ends, strict=True) if len(found)), mode)
    return x


def _event(surface: Callable[[Array], float], direction: int) -> Callable[[float, Array], float]:
    def event(t: float, y: Array) -> float:
        return surface(y)

    event.terminal = True  # type: ignore[attr-defined]  # scipy reads both from the function
    event.direction = direction  # type: ignore[attr-defined]  # as above
    return event


@dataclass(frozen=True)
class Measured:
    """errors: largest error of x in parts of its largest value, for each step of STEPS; order: slope over all."""

    errors: tuple[float, ...]
    order: float


def measure(name: str) -> Measured:
    """Errors of HystId.Oscillators.<name> at fixed steps against the reference."""
    model = CompiledModel(compile_model(f"HystId.Oscillators.{name}"))
    common = np.arange(round(STOP / FINEST / STEPS[0]) + 1) * FINEST * STEPS[0]
    exact = reference(LAWS[name], common)
    errors = []
    for factor in STEPS:
        t = np.arange(round(STOP / FINEST / factor) + 1) * FINEST * factor
        got = model.simulate(
            {"F": force(t)}, FINEST * factor, outputs=["x"], parameters={"v_start": V_START}, interpolation="cubic"
        )
        errors.append(float(np.abs(got["x"][:: STEPS[0] // factor] - exact).max() / np.abs(exact).max()))
    return Measured(tuple(errors), float(np.log2(errors[0] / errors[-1]) / np.log2(STEPS[0] / STEPS[-1])))


def main() -> None:
    """Prints the table."""
    steps = " | ".join(f"{FINEST * f * 1e6:.0f} us" for f in STEPS)
    print(f"| oscillator | {steps} | order | expected | why |\n|{'---|' * (len(STEPS) + 4)}")
    for name, law in LAWS.items():
        found = measure(name)
        errors = " | ".join(f"{e:.1e}" for e in found.errors)
        print(f"| {name} | {errors} | {found.order:.1f} | {law.expected:g} | {law.reason} |")


if __name__ == "__main__":
    main()
