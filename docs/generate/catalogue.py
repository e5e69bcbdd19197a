"""Pages of the catalogue, made from the Modelica library: every law and every effect runs as it is compiled.

Run: ``python -m docs.generate.catalogue [FOLDER]``. Nothing about a law is written here. Names, texts,
parameters and equations come from the ``.mo`` files, loops and figures from the compiled blocks on the motions below.
Look-alikes are computed: what a block adds to a linear oscillator, after mass, damping, stiffness and a constant have
been refitted, is compared with what every other block can add.
"""

from __future__ import annotations

import html
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.pictures import Panel, write
from hystid.compiled import CompiledModel
from hystid.diagnosis.model.effects import Effect, Scales, Signals
from hystid.diagnosis.model.library import load_effects
from hystid.modelica import compile_model
from hystid.modelica.sources import library_folder

Array = NDArray[np.float64]
LIBRARY = library_folder() / "HystId"
BASELINE = "HystId.Forces.Jenkins"  # gives the hysteretic force h that some effects act on
DT = 1e-3  # s
FREQUENCY = 5.0  # Hz
AMPLITUDES = np.array([0.3e-3, 0.6e-3, 1.2e-3, 2.4e-3])  # m; thresholds of the library start at 1 mm
SIZE = 10.0  # N: greatest force of an effect that is drawn
CYCLES = 4
SAME = 0.99  # cosine from which no experiment of a laboratory separates two effects
CLOSE = 0.8  # cosine from which two effects are called look-alikes
LISTED = 3
COLOURS = ("published", "third", "refined", "fourth")


def motion(amplitude: float, frequency: float = FREQUENCY, offset: float = 0.0, cycles: int = CYCLES) -> Signals:
    """A harmonic motion, with the hysteretic force of the baseline law."""
    t = np.arange(round(cycles / frequency / DT) + 1) * DT
    w = 2 * np.pi * frequency
    x, v = offset + amplitude * np.sin(w * t), amplitude * w * np.cos(w * t)
    return Signals(x, v, -(w**2) * (x - offset), baseline(x, v), DT)


_LAW: list[CompiledModel] = []


def baseline(x: Array, v: Array) -> Array:
    """Force [N] of the baseline law on a motion."""
    if not _LAW:
        _LAW.append(CompiledModel(compile_model(BASELINE)))
    return law_force(_LAW[0], x, v)


def law_force(model: CompiledModel, x: Array, v: Array) -> Array:
    """Force [N] of a block with inputs x, v and output f."""
    return model.simulate({"x": x, "v": v}, DT, outputs=("f",), interpolation="cubic", substeps=4)["f"]


# What can be done in the laboratory to tell two effects from each other, as motions beside the levels of amplitude.
EXPERIMENTS: dict[str, tuple[Signals, ...]] = {}


def experiments() -> Mapping[str, tuple[Signals, ...]]:
    """Sentence -> motions; the first entry is what every test begins with."""
    if not EXPERIMENTS:
        large = float(AMPLITUDES[-1])
        EXPERIMENTS["levels"] = tuple(motion(float(a)) for a in AMPLITUDES)
        EXPERIMENTS["repeat one amplitude at several frequencies"] = tuple(motion(large, f) for f in (0.5, 20.0))
        EXPERIMENTS["add slow, quasi-static cycles"] = (motion(large, 0.25, cycles=2),)
        EXPERIMENTS["shift the mean position"] = tuple(motion(large / 2, offset=sign * large) for sign in (1.0, -1.0))
        EXPERIMENTS["go to twice the amplitude"] = (motion(2 * large),)
        EXPERIMENTS["hold one level for a long time"] = (motion(large, cycles=60),)
    return EXPERIMENTS


def scales(signals: Sequence[Signals]) -> Scales:
    """Sizes from which an effect takes the values that are tried for its shapes."""
    x, v, h = (np.sort(np.abs(np.concatenate([getattr(s, name) for s in signals]))) for name in ("x", "v", "h"))
    path = max(float(np.sum(np.abs(np.diff(s.x)))) for s in signals)
    span = max(len(s.x) * s.dt for s in signals)
    return Scales(x, v, h, span, DT, (FREQUENCY, FREQUENCY), path)


def rest_of(signals: Sequence[Signals], forces: Sequence[Array]) -> Array:
    """Forces (columns) after mass, damping, stiffness, the baseline law and a constant were refitted, shape (n, k)."""
    known = np.concatenate([np.column_stack([s.x, s.v, s.a, s.h, np.ones_like(s.x)]) for s in signals])
    basis, _ = np.linalg.qr(known / np.linalg.norm(known, axis=0))
    columns = np.concatenate(forces)
    return columns - basis @ (basis.T @ columns)


def added(effect: Effect, signals: Sequence[Signals], shapes: Mapping[str, float]) -> Array:
    """What each amplitude of the effect adds, after the refit, shape (n, amplitudes)."""
    units = effect.units_at(shapes)
    return rest_of(signals, [np.column_stack([effect.force(s, unit) for unit in units]) for s in signals])


def drawn_values(effect: Effect) -> dict[str, float]:
    """Shapes as the block states them; amplitudes that make the greatest force ``SIZE``, shares at most 0.9."""
    shapes = {s.name: float(s.start or 0.0) for s in effect.shapes}
    shapes |= {name: float(max(values)) for name, values in effect.choices.items()}
    one = {**shapes, **dict.fromkeys(effect.amplitudes, 1.0)}
    largest = float(np.max(np.abs(effect.force(motion(float(AMPLITUDES[-1])), one))))
    factor = SIZE / largest if largest > 0 else 1.0
    return {**shapes, **{n: min(factor, 0.9) if effect.units[n] == "1" else factor for n in effect.amplitudes}}


@dataclass(frozen=True)
class Likeness:
    """How alike another effect is on levels of amplitude, and how alike it stays when one more experiment is added."""

    other: str
    before: float
    after: float
    experiment: str

    @property
    def tells(self) -> str:
        """The experiment, or why there is none."""
        if self.after > SAME:
            return "none of these: one law holds the other as a special case, and the simpler one is named"
        return self.experiment if self.after < self.before - 0.02 else "none of these; more levels near the onset help"


def closeness(column: Array, others: Sequence[Array]) -> float:
    """Largest cosine between a column and the spaces of the other columns."""
    size = float(np.linalg.norm(column))
    found = 0.0
    for other in others:
        kept = other[:, np.linalg.norm(other, axis=0) > 1e-9 * np.linalg.norm(other)]
        if kept.size and size > 0:
            basis, _ = np.linalg.qr(kept)
            found = max(found, float(np.linalg.norm(basis.T @ column)) / size)
    return found


class Comparison:
    """Every effect on every experiment, computed once."""

    def __init__(self, effects: Sequence[Effect]) -> None:
        self.effects = {effect.id: effect for effect in effects if not effect.form}
        base = experiments()["levels"]
        self.tests = {name: base if name == "levels" else (*base, *more) for name, more in experiments().items()}
        size = scales(base)
        self.columns: dict[tuple[str, str], list[Array]] = {}
        self.own: dict[tuple[str, str], Array] = {}
        for name, signals in self.tests.items():
            for ident, effect in self.effects.items():
                points = effect.grid(size)
                chosen = [points[k] for k in np.unique(np.linspace(0, len(points) - 1, 5).astype(int))]
                self.columns[ident, name] = [added(effect, signals, shapes) for shapes in chosen]
                values = drawn_values(effect)
                force = [effect.force(s, values)[:, None] for s in signals]
                self.own[ident, name] = rest_of(signals, force)[:, 0]

    def alike(self, ident: str) -> list[Likeness]:
        """The closest other effects, and for each the experiment that separates it best."""
        found = []
        for other in self.effects:
            if other == ident:
                continue
            by_test = {n: closeness(self.own[ident, n], self.columns[other, n]) for n in self.tests}
            before = by_test.pop("levels")
            best = min(by_test, key=by_test.__getitem__)
            if before >= CLOSE:
                found.append(Likeness(other, before, by_test[best], best))
        return sorted(found, key=lambda one: -one.before)[:LISTED]

    def hidden(self, ident: str) -> float:
        """Share of the effect's force that the refit of the baseline takes up, on levels of amplitude."""
        effect, signals = self.effects[ident], self.tests["levels"]
        values = drawn_values(effect)
        force = np.concatenate([effect.force(s, values) for s in signals])
        return float(1 - np.sum(self.own[ident, "levels"] ** 2) / np.sum(force**2))


def picture(path: Path, title: str, forces: Sequence[tuple[float, Signals, Array]]) -> None:
    """Loop, force over velocity, and the signature over amplitude, side by side."""
    loop = Panel("Force over displacement", "x [mm]", "f [N]")
    speed = Panel("Force over velocity", "v [mm/s]", "f [N]")
    last = slice(-round(1 / FREQUENCY / DT) - 1, None)
    for colour, (amplitude, s, f) in zip(COLOURS, forces, strict=True):
        label = f"{1e3 * amplitude:.2g} mm"
        loop.line(1e3 * s.x[last], f[last], colour, label)
        speed.line(1e3 * s.v[last], f[last], colour, label)
    signature = Panel("Harmonics of the force", "amplitude [mm]", "f [N]", log_x=True, log_y=True)
    write(path, title, [loop, speed, _signature(signature, forces)], 3, (330, 230))


def _signature(panel: Panel, forces: Sequence[tuple[float, Signals, Array]]) -> Panel:
    last = slice(-round(1 / FREQUENCY / DT) - 1, -1)
    amplitudes = 1e3 * np.array([amplitude for amplitude, _, _ in forces])
    spectra = np.array([np.abs(np.fft.rfft(f[last])) * 2 / len(f[last]) for _, _, f in forces])
    floor = max(1e-4 * float(spectra.max()), 1e-12)
    for order, colour, dash in ((1, "linear", ""), (2, "refined", "5 3"), (3, "published", "")):
        panel.line(amplitudes, np.maximum(spectra[:, order], floor), colour, f"harmonic {order}", dash)
    return panel


def source(path: Path) -> tuple[str, str, str]:
    """One line, documentation and equations of a Modelica file, as they stand there."""
    text = path.read_text(encoding="utf-8")
    line = re.search(r'^(?:block|model)\s+\w+\s+"([^"]*)"', text, re.MULTILINE)
    info = re.search(r'info\s*=\s*"<html>(.*?)</html>"', text, re.DOTALL)
    body = re.search(r"^equation\n(.*?)^\s*annotation", text, re.DOTALL | re.MULTILINE)
    words = html.unescape(re.sub(r"<[^>]+>", "", info.group(1))) if info else ""
    return (line.group(1) if line else "", " ".join(words.split()), body.group(1).rstrip() if body else "")


def table(variables: Sequence[tuple[str, str, float, str]]) -> str:
    """Parameters as a Markdown table."""
    rows = [f"| `{name}` | {unit or '1'} | {start:g} | {text} |" for name, unit, start, text in variables]
    return "\n".join(["| parameter | unit | default | meaning |", "|---|---|---|---|", *rows])


def parameters(model: CompiledModel) -> list[tuple[str, str, float, str]]:
    """Name, unit, default and text of every parameter of a block."""
    found = [v for v in model.code.variables if v.causality == "parameter"]
    return [(v.name, v.unit, float(v.start or 0.0), v.description) for v in found]


def effect_page(effect: Effect, forms: Sequence[str], comparison: Comparison, folder: Path) -> str:
    """Markdown of one effect; its picture goes beside."""
    name, title = effect.class_name.rpartition(".")[2], effect.semantics.title
    line, words, equations = source(LIBRARY / "Effects" / f"{name}.mo")
    assert effect.model is not None
    values = drawn_values(effect)
    forces = [(float(a), s, effect.force(s, values)) for a, s in zip(AMPLITUDES, experiments()["levels"], strict=True)]
    picture(folder / f"{effect.id}.svg", f"{title} ({name})", forces)
    alike = comparison.alike(effect.id)
    links = [f"[{comparison.effects[one.other].semantics.title}](#{one.other.replace('_', '-')})" for one in alike]
    rows = [
        f"| {link} | {one.before:.2f} | {one.tells} | {one.after:.2f} |" for link, one in zip(links, alike, strict=True)
    ]
    head = ["| mistaken for | likeness | experiment that tells | likeness then |", "|---|---|---|---|"]
    others = "\n".join([*head, *rows]) if rows else "No other effect of the library is like it on these motions."
    others_of = [f"`{form}`: {source(LIBRARY / 'Effects' / f'{name}__{form}.mo')[0]}" for form in forms]
    more = "Other forms of the same law: " + "; ".join(others_of) + "." if others_of else ""
    given = ", ".join(f"{key} = {value:.3g}" for key, value in values.items())
    parts = [
        f"## {title[:1].upper() + title[1:]} {{ #{effect.id.replace('_', '-')} }}", f"{line}. {words}",
        f"`HystId.Effects.{name}`, id `{effect.id}`. {more}", f"![{title}]({effect.id}.svg)",
        f"Drawn with {given}. The refit of mass, damping, stiffness and the baseline law takes up"
        f" {100 * comparison.hidden(effect.id):.0f} % of this force: that share cannot be seen as a misfit.",
        f"What shows it where recordings do not: {effect.semantics.experiment}.",
        table(parameters(effect.model)), f"```modelica\n{equations}\n```", others,
    ]  # fmt: skip
    return "\n\n".join(part for part in parts if part)


def oscillator_page(path: Path, folder: Path) -> str:
    """Markdown of one law of restoring force and its oscillator."""
    line, words, equations = source(path)
    model = CompiledModel(compile_model(f"HystId.Forces.{path.stem}"))
    levels = zip(AMPLITUDES, experiments()["levels"], strict=True)
    forces = [(float(amplitude), s, law_force(model, s.x, s.v)) for amplitude, s in levels]
    picture(folder / f"{path.stem}.svg", path.stem, forces)
    parts = [
        f"## {path.stem}", f"{line}. {words}", f"`HystId.Oscillators.{path.stem}`, law `HystId.Forces.{path.stem}`.",
        f"![{path.stem}]({path.stem}.svg)", table(parameters(model)), f"```modelica\n{equations}\n```",
    ]  # fmt: skip
    return "\n\n".join(parts)


def main(folder: Path) -> list[Path]:
    """Write ``oscillators.md``, ``effects.md`` and their pictures; returns the pages."""
    folder.mkdir(parents=True, exist_ok=True)
    effects = load_effects()
    forms: dict[str, list[str]] = {}
    for effect in effects:
        forms.setdefault(effect.id, []).extend([effect.form] if effect.form else [])
    comparison = Comparison(effects)
    laws = sorted((LIBRARY / "Forces").glob("*.mo"))
    levels = ", ".join(f"{1e3 * a:g}" for a in AMPLITUDES)
    how = f"Motion: x = X sin(2π · {FREQUENCY:g} Hz · t) with X = {levels} mm, from rest; the last of {CYCLES} cycles."
    pages = {
        "oscillators.md": [
            "# Oscillators",
            "One mass on a spring, a damper and a law with memory: m a + B v + Kl x + f_h = F. Each law is one Modelica"
            f" block, drawn here as it is compiled, with its default parameters. {how}",
            *(oscillator_page(path, folder) for path in laws if path.stem != "package"),
        ],
        "effects.md": [
            "# Effects",
            "What a model may have left out. Each effect is one Modelica block that adds a force f to R. `hystid"
            f" diagnose` tries all of them. {how}",
            "Likeness is the cosine between what two effects add to a linear oscillator with a Jenkins element, after"
            " mass, damping, stiffness, the element's force and a constant have been refitted: 1 cannot be told apart,"
            " 0 has nothing in common. The experiment is the one of five that lowers the likeness most; where it stays"
            " near 1, no motion of this kind separates the two.",
            *(effect_page(e, forms[e.id], comparison, folder) for e in effects if not e.form),
        ],
    }  # fmt: skip
    for name, parts in pages.items():
        (folder / name).write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return [folder / name for name in pages]


if __name__ == "__main__":
    for page in main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/generated")):
        print(page)
