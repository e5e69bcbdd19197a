"""First steps from Python: Modelica -> FMU -> recordings -> surrogate -> co-simulation, in one short script.

Run: ``python examples/first_steps.py [DIR]``. A minute on one core. The same from the command line:

    hystid build HystId.Oscillators.BoucWen -o boucwen.fmu
    hystid simulate boucwen.fmu --force multisine:5-60Hz@40Nrms,4s --noise-snr 40 -o train.csv
    hystid identify train.csv --mass 1 --ensemble 10 --band 0-500Hz --decimate 4 -o model
    hystid validate model/surrogate.fmu --against boucwen.fmu --force harmonic:12Hz@40N,2s -o check
"""

from __future__ import annotations

import sys
from pathlib import Path

import hystid

MODEL = "HystId.Oscillators.BoucWen"
MASS = 1.0  # kg, the model's own
TRAINING = tuple(f"multisine:5-60Hz@{level}Nrms,4s" for level in (15, 30, 45))
UNSEEN = ("harmonic:12Hz@40N,2s", "chirp:5-50Hz@40N,4s")


def main(out: Path) -> None:
    """Run everything and write models and reports below ``out``."""
    out.mkdir(parents=True, exist_ok=True)
    fmu = hystid.build(MODEL, out / "boucwen.fmu").path
    recordings = [hystid.simulate(fmu, text, noise_snr=40, seed=k) for k, text in enumerate(TRAINING)]

    model = hystid.identify(recordings, mass=MASS, ensemble=10, band=(None, 500.0), decimate=4, out=out / "model")
    model.report(out / "model" / "report.html", "python examples/first_steps.py")
    print(model.summary())

    check = hystid.validate(out / "model" / "surrogate.fmu", reference=fmu, forces=UNSEEN, out=out / "check")
    check.report(out / "check" / "report.html", "python examples/first_steps.py")
    print(check.summary())


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "first-steps"))
