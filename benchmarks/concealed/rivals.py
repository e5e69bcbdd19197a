"""Other ways to look for what was left out, on the same deck: refit only, stepwise BIC, PySINDy, a residual network.

``python -m benchmarks.concealed.rivals DECK`` reads the cases of a scored deck (``DECK/case_*``, ``DECK/sealed``) and
writes ``rivals.json``. All of them start from the refitted baseline and see smoothed channels; what they add is
a force of (x, v) tabulated for the free run, a carried mass, or a stiffness that drifts. PySINDy comes with the extra
``bench``.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from benchmarks.concealed.baselines import MODELS, Baseline, Scale, rig_of
from benchmarks.concealed.grade import Grade, grade
from benchmarks.concealed.oracle import refit
from benchmarks.concealed.rig import Array, Diverged, Element, Rig, run
from hystid.files import write_json
from hystid.progress import track

Surface = Callable[[Array, Array], Array]
MOST_TERMS = 3
GRID = 61


@dataclass(frozen=True)
class Ready:
    """A case after the refit. data: smoothed channels and t per recording; residual: F - m a - baseline [N]."""

    baseline: Baseline
    fitted: dict[str, float]
    data: tuple[dict[str, Array], ...]
    residual: Array
    weights: Array
    holdout: dict[str, Array]

    def stacked(self, channel: str) -> Array:
        """One channel of all recordings, end to end."""
        return np.concatenate([d[channel] for d in self.data])

    def rig(self, extra: tuple[Element, ...] = ()) -> Rig:
        """The refitted baseline with additions."""
        rig = rig_of(self.baseline.family, self.fitted, self.baseline.scale.V)
        return replace(rig, elements=(*rig.elements, *extra))


@dataclass(frozen=True)
class Guess:
    """What a rival says: ids in order of importance, and what to add to the model."""

    names: tuple[str, ...] = ()
    extra: tuple[Element, ...] = ()


def prepare(case: Path) -> Ready:
    """Read a case as a diagnosis would get it, smooth it (zero phase, 0.2 of the sample rate), refit the baseline."""
    handed = json.loads((case / "case.json").read_text(encoding="utf-8"))
    nominal = json.loads((case / "parameters.json").read_text(encoding="utf-8"))
    family = next(name for name, model in MODELS.items() if model == handed["model"])
    raw = [_read(case / name) for name in handed["recordings"]]
    data = [_smooth(channels) for channels in raw]
    X, V = (max(float(np.max(np.abs(d[c]))) for d in data) for c in "xv")
    baseline = Baseline(family, nominal, Scale(X, V, nominal["Kl"], nominal["m"], 0.0, 1.0, float(data[0]["t"][-1])))
    weights = [1 / float(np.std(d["F"] - nominal["m"] * d["a"])) for d in data]
    fitted, left = refit(baseline, data, weights, nominal["m"], float(data[0]["t"][1]))
    spread = np.concatenate([np.full(len(d["t"]), w) for d, w in zip(data, weights, strict=True)])
    return Ready(baseline, fitted, tuple(data), left / spread, spread, _read(case / handed["holdout"][0]))


def _read(file: Path) -> dict[str, Array]:
    with file.open(encoding="utf-8") as text:
        names = [title.split()[0] for title in text.readline().split(",")]
        return dict(zip(names, np.loadtxt(text, delimiter=",").T, strict=True))


def _smooth(channels: Mapping[str, Array]) -> dict[str, Array]:
    sections = butter(4, 0.4, output="sos")
    return {name: y if name == "t" else sosfiltfilt(sections, y) for name, y in channels.items()}


def refit_only(ready: Ready) -> Guess:
    """The baseline with its best parameters: never names anything."""
    return Guess()


def stepwise_bic(ready: Ready) -> Guess:
    """Forward selection of up to three columns with a name, by BIC over all samples; spring and damper are refitted."""
    x, v = ready.stacked("x"), ready.stacked("v")
    terms = _terms(ready)
    columns = {key: term(x, v) for key, term in terms.items()}
    columns |= {("added_mass", 0.0): ready.stacked("a"), ("stiffness_drift", 0.0): x * ready.stacked("t")}
    chosen: list[tuple[str, float]] = []
    best = _bic(ready, [x, v])
    while len(chosen) < MOST_TERMS:
        scores = {
            key: _bic(ready, [x, v, *(columns[k] for k in (*chosen, key))]) for key in columns if key not in chosen
        }
        winner = min(scores, key=lambda key: scores[key])
        if scores[winner] >= best:
            break
        best, chosen = scores[winner], [*chosen, winner]
    weights = _solve(ready, [x, v, *(columns[k] for k in chosen)])
    return Guess(
        tuple(dict.fromkeys(_name(k, w) for k, w in zip(chosen, weights[2:], strict=True))),
        _added(ready, terms, chosen, weights),
    )


def _terms(ready: Ready) -> dict[tuple[str, float], Surface]:
    """Columns by (id, place): one per memoryless law, contact at several places on both sides."""
    X, V = ready.baseline.scale.X, ready.baseline.scale.V
    terms: dict[tuple[str, float], Surface] = {
        ("cubic_stiffness", 0.0): lambda x, v: (x / X) ** 3,
        ("quadratic_stiffness", 0.0): lambda x, v: (x / X) ** 2,
        ("bilinear_stiffness", 0.0): lambda x, v: np.abs(x) / X,
        ("coulomb_friction", 0.0): lambda x, v: np.tanh(v / (0.01 * V)),
        ("position_dependent_friction", 1.0): lambda x, v: x / X * np.tanh(v / (0.01 * V)),
        ("position_dependent_friction", 2.0): lambda x, v: np.abs(x) / X * np.tanh(v / (0.01 * V)),
        ("quadratic_damping", 0.0): lambda x, v: v * np.abs(v) / V**2,
        ("displacement_dependent_damping", 0.0): lambda x, v: x * x * v / (X * X * V),
        ("preload", 0.0): lambda x, v: np.ones_like(x),
    }
    for place in (-0.75, -0.6, -0.45, 0.45, 0.6, 0.75):
        terms["contact", place] = lambda x, v, g=place: np.sign(g) * np.maximum(np.sign(g) * x / X - abs(g), 0)  # type: ignore[misc]
    for place in (0.15, 0.3, 0.45, 0.6):
        terms["two_sided_stop", place] = lambda x, v, g=place: np.sign(x) * np.maximum(np.abs(x) / X - g, 0)  # type: ignore[misc]
    return terms


def _name(key: tuple[str, float], weight: float) -> str:
    return key[0] if key[0] != "contact" else ("impact" if weight > 0 else "contact_loss")


def _solve(ready: Ready, columns: Sequence[Array]) -> Array:
    table = np.column_stack(columns) * ready.weights[:, None]
    return np.asarray(np.linalg.lstsq(table, ready.residual * ready.weights, rcond=None)[0])


def _bic(ready: Ready, columns: Sequence[Array]) -> float:
    left = (ready.residual - np.column_stack(columns) @ _solve(ready, columns)) * ready.weights
    n = len(left)
    return float(n * np.log(np.mean(left**2)) + len(columns) * np.log(n))


def _added(
    ready: Ready, terms: Mapping[tuple[str, float], Surface], chosen: Sequence[tuple[str, float]], weights: Array
) -> tuple[Element, ...]:
    extra = []
    for key, weight in zip(chosen, weights[2:], strict=True):
        if key[0] == "added_mass":
            extra.append(Element("mass", (), float(weight)))
        if key[0] == "stiffness_drift":
            extra.append(Element("drift", (1.0, 1.0, 0), float(weight)))
    surfaces = [(terms[k], w) for k, w in zip(chosen, weights[2:], strict=True) if k in terms]

    def surface(x: Array, v: Array) -> Array:
        start = weights[0] * x + weights[1] * v
        return np.asarray(start + sum((w * f(x, v) for f, w in surfaces), np.zeros_like(x)))

    return (*extra, tabulated(ready, surface))


def tabulated(ready: Ready, surface: Surface) -> Element:
    """A force of (x, v) as a table over 1.2 times the recorded range."""
    X, V = 1.2 * ready.baseline.scale.X, 1.2 * ready.baseline.scale.V
    x, v = np.linspace(-X, X, GRID), np.linspace(-V, V, GRID)
    values = surface(*(part.ravel() for part in np.meshgrid(x, v, indexing="ij")))
    return Element("table", (-X, 2 * X / (GRID - 1), GRID, -V, 2 * V / (GRID - 1), GRID, *values), 1.0)


def sparse_regression(ready: Ready) -> Guess:
    """PySINDy, sequentially thresholded least squares on scaled terms, the threshold chosen on the last recording."""
    import pysindy  # type: ignore[import-untyped]

    X, V = ready.baseline.scale.X, ready.baseline.scale.V
    terms = {key: term for key, term in _terms(ready).items() if key[0] not in ("contact", "two_sided_stop")}
    functions = [lambda x, v: x / X, lambda x, v: v / V, *terms.values()]
    state = np.column_stack([ready.stacked("x"), ready.stacked("v")])
    scale = float(np.std(ready.residual))
    rate = np.column_stack([ready.residual / scale, np.zeros(len(state))])
    cut = len(state) - len(ready.data[-1]["t"])
    dt = float(ready.data[0]["t"][1])

    def fitted(threshold: float, rows: slice) -> Array:
        model = pysindy.SINDy(
            optimizer=pysindy.STLSQ(threshold=threshold),
            feature_library=pysindy.CustomLibrary(
                library_functions=functions, function_names=[_label(f) for f in functions]
            ),
        )
        with warnings.catch_warnings():  # a threshold that leaves no term is one of the choices
            warnings.simplefilter("ignore")
            model.fit(state[rows], t=dt, x_dot=rate[rows])
        return np.asarray(model.coefficients()[0])

    def left(threshold: float) -> float:
        weights = fitted(threshold, slice(0, cut))
        said = sum(w * f(state[cut:, 0], state[cut:, 1]) for w, f in zip(weights, functions, strict=True))
        return float(np.mean((rate[cut:, 0] - said) ** 2))

    threshold = min((0.1, 0.3, 1.0, 3.0), key=left)
    weights = scale * fitted(threshold, slice(None))
    order = np.argsort(-np.abs(weights[2:]))
    keys = list(terms)
    names = tuple(dict.fromkeys(keys[i][0] for i in order if weights[2 + i] != 0))

    def surface(x: Array, v: Array) -> Array:
        return np.asarray(sum((w * f(x, v) for w, f in zip(weights, functions, strict=True)), np.zeros_like(x)))

    return Guess(names, (tabulated(ready, surface),))


def _label(function: object) -> Callable[[str, str], str]:
    return lambda x, v: f"{id(function)}({x},{v})"


def residual_network(ready: Ready) -> Guess:
    """A network of 16 tanh neurons on (x, v), with early stopping: fits, never names."""
    from sklearn.neural_network import MLPRegressor  # type: ignore[import-untyped]

    X, V, scale = ready.baseline.scale.X, ready.baseline.scale.V, float(np.std(ready.residual))
    inputs = np.column_stack([ready.stacked("x") / X, ready.stacked("v") / V])
    network = MLPRegressor(
        hidden_layer_sizes=(16,), activation="tanh", early_stopping=True, random_state=0, max_iter=100
    )
    with warnings.catch_warnings():  # the last epoch counts as its answer
        warnings.simplefilter("ignore")
        network.fit(inputs[::4], ready.residual[::4] / scale)
    return Guess((), (tabulated(ready, lambda x, v: scale * network.predict(np.column_stack([x / X, v / V]))),))


RIVALS: dict[str, Callable[[Ready], Guess]] = {
    "refit only": refit_only,
    "stepwise BIC": stepwise_bic,
    "PySINDy": sparse_regression,
    "residual network": residual_network,
}


def free_run_error(ready: Ready, extra: tuple[Element, ...]) -> float:
    """NRMSE of x on the held-out test under its measured force; 10 where the run diverges."""
    t, q = ready.holdout["t"], 4
    n = (len(t) - 1) * q
    fine = CubicSpline(t, ready.holdout["F"])(np.linspace(0, t[-1], 2 * n + 1))
    try:
        x = run(ready.rig(extra), fine, t[-1] / n, (ready.holdout["x"][0], 0.0)).x[::q]
    except Diverged:
        return 10.0
    error = np.sqrt(np.mean((x - ready.holdout["x"]) ** 2)) / np.std(ready.holdout["x"])
    return float(min(error, 10.0))


def judge(case: Path, sealed: Path, rivals: Mapping[str, Callable[[Ready], Guess]] = RIVALS) -> dict[str, Grade]:
    """Run the rivals on one case and grade them by the rules of the deck."""
    truth = json.loads((sealed / f"{case.name}.json").read_text(encoding="utf-8"))
    start = time.process_time()
    ready = prepare(case)
    shared = time.process_time() - start
    before = free_run_error(ready, ())
    grades = {}
    for name, rival in rivals.items():
        start = time.process_time()
        guess = rival(ready)
        cost = shared + time.process_time() - start
        findings = [{"effect": n, "class": [], "parameters": {}} for n in guess.names]
        fit = {"holdout": [{"before": before, "after": free_run_error(ready, guess.extra)}]}
        answer = {"verdict": "missing_physics" if findings else "recalibrated", "findings": findings, "fit": fit}
        grades[name] = replace(grade(case.name, truth, answer, case, sealed), cpu_s=cost)
    return grades


def summarise(grades: Sequence[Grade]) -> dict[str, Any]:
    """Rates and medians of one rival."""

    def share(values: Sequence[bool | None]) -> float | None:
        known = [v for v in values if v is not None]
        return float(np.mean(known)) if known else None

    gains = [g.gain for g in grades if g.gain is not None and g.group in ("single", "part_time", "pair")]
    one = [g for g in grades if g.group in ("single", "part_time")]
    return {
        "name_right": share([g.name_right for g in one]),
        "class_right": share([g.class_right for g in one]),
        "wrong_name": share([g.wrong_name for g in grades]),
        "false_alarm": share([g.false_alarm for g in grades]),
        "gain": float(np.median(gains)) if gains else None,
        "cpu_s": float(np.median([g.cpu_s for g in grades if g.cpu_s is not None])),
        "cases": len(grades),
    }


def compare(folder: Path, cases: int = 0) -> dict[str, Any]:
    """All rivals on a deck (its first so many cases); writes ``rivals.json`` beside the deck."""
    found: dict[str, list[Grade]] = {name: [] for name in RIVALS}
    places = [case for case in sorted(folder.glob("case_*")) if _has_motion(case)][: cases or None]
    with track("rivals", len(places)) as step:
        for case in places:
            for name, graded in judge(case, folder / "sealed").items():
                found[name].append(graded)
            step(text=case.name)
    results = {name: summarise(grades) for name, grades in found.items()}
    write_json(folder.parent / "rivals.json", results)
    return results


def _has_motion(case: Path) -> bool:
    handed = json.loads((case / "case.json").read_text(encoding="utf-8"))
    return set(handed["channels"]) >= {"x", "v", "a", "F"}


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Run rivals of the diagnosis on a deck.")
    parser.add_argument("deck", type=Path)
    parser.add_argument("--cases", type=int, default=0, help="only the first so many")
    chosen = parser.parse_args(arguments)
    for name, row in compare(chosen.deck, chosen.cases).items():
        print(name, row)


if __name__ == "__main__":
    main()
