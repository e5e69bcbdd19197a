"""``hystid demo``: the virtual experiment end to end, every figure computed in the run.

Part 1, the reference study in small: a stick-slip oscillator from Modelica, shaken by noisy chirps as an FMU,
identified by the two-network method, and co-simulated against its surrogate FMU under tests that it has not seen.
Part 2, the lab case: the same oscillator conceals a loss of contact. A surrogate fits it without explaining it; the
diagnosis names what is missing, writes it as Modelica, and predicts unseen tests with it.
"""

from __future__ import annotations

from pathlib import Path

from hystid.files import write_json
from hystid.progress import track
from hystid.virtual_experiment.demo_page import write_page
from hystid.virtual_experiment.lab import lab_case
from hystid.virtual_experiment.reference_study import FULL, Size, reference_study
from hystid.virtual_experiment.targets import Check, Outcome

__all__ = ["FULL", "Check", "Outcome", "Size", "demo"]


def demo(out: str | Path, size: Size = FULL) -> Outcome:
    """Run both parts and write everything, ``report.html`` and ``demo.json`` on top, into the folder ``out``.

    size: how much is trained (the figures are judged by the same targets whatever the size). The full size takes a
    minute or two.

    >>> import hystid
    >>> print(hystid.demo("demo").summary())  # doctest: +SKIP
    """
    folder = Path(out)
    with track("demo", 2) as step:
        study = reference_study(folder, size)
        step(1, "reference study done")
        lab = lab_case(folder / "lab", size)
        step(1, "lab case done")
    outcome = Outcome(folder, (*study.checks, *lab.checks))
    write_page(study, lab, outcome, folder / "report.html")
    write_json(folder / "demo.json", outcome.as_dict())
    return outcome
