"""The two pictures of docs/diagnosis.md: ``python -m benchmarks.diagnosis_pictures -o docs``.

The first shows the lab case (``examples/lab_case.py``): what the refitted model leaves of the force, and what is left
beside each law that was tried. The second shows what the criterion makes of such figures. Everything is computed by
the diagnosis itself.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.pictures import Panel, write
from hystid.diagnosis.decide.criterion import PRIOR, Criterion
from hystid.diagnosis.decide.selection import Choice, choose
from hystid.diagnosis.fit.case import pose
from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.model.library import load_effects
from hystid.diagnosis.prepare.given import given_parameters
from hystid.diagnosis.prepare.recordings import take

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from lab_case import BELIEVED, NOMINAL, record

_DOTS = 1500  # of a panel
_SAMPLES = np.geomspace(200, 1e6, 60)
_ERROR = 0.05  # of the force: what the wrong law of the second picture leaves, where the right one leaves 0.01
_SHARES = np.geomspace(1e-4, 1, 80)  # of the misfit that a law leaves


def left_of_the_force(problem: Problem, choice: Choice) -> list[Panel]:
    """Force that the refitted model, and the extended one, leave over the displacement; bands of noise."""
    panels = []
    stated = (("The refitted model leaves this", choice.before), ("With the named law", choice.after))
    top = float(np.max(np.abs(_force(problem, choice.before)[1])))
    for title, fit in stated:
        x, rest = _force(problem, fit)
        step = max(1, len(x) // _DOTS)
        noise = 2 * max(part.balance_noise(fit.hypothesis.mass()) for part in problem.parts)
        panel = Panel(title, "displacement [mm]", "force not explained [N]", limits=(-1.1 * top, 1.1 * top))
        panel.line(1e3 * x[::step], rest[::step], "measured", "force that is left", "dots")
        ends = 1e3 * np.array([x.min(), x.max()])
        for side in (-noise, noise):
            panel.line(ends, np.full(2, side), "refined", "two standard deviations of its noise", "4 3")
        panels.append(panel)
    return panels


def _force(problem: Problem, fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Displacement [m] and force [N] that a model leaves of all recordings."""
    rest = np.concatenate(problem.balance(fit.hypothesis))
    return np.concatenate([part.x for part in problem.parts]), rest


def what_it_says(criterion: Criterion, whole: float) -> list[Panel]:
    """Likelihood over the number of samples, and probability of a name over what its law leaves.

    whole: mean square of the misfit above the noise.
    """
    states, force = criterion.states, criterion.force
    usual, ours = [], []
    for samples in _SAMPLES:
        criterion.each = samples / states
        ours.append(criterion.likelihood(0.01**2 * force) - criterion.likelihood(_ERROR**2 * force))
        usual.append(0.5 * samples * np.log((1 + _ERROR**2 * force) / (1 + 0.01**2 * force)))
    first = Panel("Right law (1 % left) over a wrong one (5 %)", "samples", "ln of the likelihood ratio", True, True)
    first.line(_SAMPLES, usual, "measured", "model error taken for noise", "4 3")
    first.line(_SAMPLES, ours, "refined", "criterion")
    criterion.each = criterion.rows / states
    odds = np.array([np.exp(criterion.form(share * whole, whole)) for share in _SHARES]) * PRIOR[1] / PRIOR["unknown"]
    second = Panel("A single law against an unknown one", "share of the misfit that it leaves", "probability", True)
    second.limits = (0.0, 1.0)
    second.line(_SHARES, odds / (1 + odds), "refined")
    return [first, second]


def main(given: Sequence[str] | None = None) -> int:
    """Arguments are those of the module's text."""
    parser = argparse.ArgumentParser()
    parser.add_argument("-o", "--out", type=Path, default=Path("build/pictures"))
    out = parser.parse_args(given).out
    case = pose(take(record()[0], [], given_parameters(NOMINAL)), BELIEVED)
    choice = choose(case.problem, case.refit, load_effects(), minima=case.minima)
    write(
        out / "diagnosis-rest.svg",
        "What is left of the force: the lab case",
        left_of_the_force(case.problem, choice),
        2,
    )
    criterion = Criterion(case.problem, case.refit, 30)
    whole = choice.before.chi2 - choice.floor_before
    write(out / "diagnosis-criterion.svg", "From what is left to a probability", what_it_says(criterion, whole), 2)
    print("| answer | probability | share of the misfit that it explains |\n|---|---|---|")
    print(f"| nothing is missing | {choice.posterior.nothing:.2g} | |")
    print(f"| no law of the library | {choice.posterior.unknown:.2g} | |")
    for candidate in choice.posterior.candidates[:5]:
        print(f"| {', '.join(candidate.names)} | {candidate.probability:.2g} | {100 * candidate.explained:.2f} % |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
