"""Physics plus network: a stage with friction and slack that are known, and cogging that no law knows.

1. What is known of the stage is written down in Modelica (``known.mo``), with rough values.
2. ``hystid identify --model`` fits that law and small networks for what it leaves together, on one recording.
3. Recordings that nobody has seen, louder and of another kind, show the gain of each part: linear fit, law alone,
   networks alone, both; and the share of each that lies in the 90 % band of both.

Run: ``python examples/hybrid.py [-o DIR]``. Exit code 1 where both together do not beat each alone.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from hystid import simulate
from hystid.fmu import build
from hystid.identification import Identification, identify
from hystid.modelica import compile_model
from hystid.recording import Recording

STAGE = """model Stage "Linear-motor stage: friction, slack in its spring, and cogging of its magnets"
  extends HystId.Oscillators.Linear(
    m = 1, B = 12, Kl = 1.2e4, f_effects = dry.f + slack.f + A*sin(6.283185307*x/pitch));
  parameter Real A(unit = "N") = 4 "Cogging force";
  parameter Real pitch(unit = "m") = 5e-3 "Pitch of the magnets";
  HystId.Effects.CoulombFriction dry(Fc = 6);
  HystId.Effects.Backlash slack(k = 8e3, gap = 2e-3);
equation
  dry.x = x;
  dry.v = v;
  dry.a = a;
  dry.h = f_h;
  slack.x = x;
  slack.v = v;
  slack.a = a;
  slack.h = f_h;
end Stage;
"""
KNOWN = (
    re.sub(r" \+ A\*sin.*?pitch\)|  parameter.*\n", "", STAGE)
    .replace("Kl = 1.2e4", "Kl = 1e4")
    .replace("Fc = 6", "Fc = 3")
    .replace("k = 8e3, gap = 2e-3", "k = 1e4, gap = 1e-3")
)
TRAIN = "multisine:5-35Hz@32Nrms,2s"
UNSEEN = ("chirp:5-35Hz@40N,4s", "multisine:5-35Hz@28Nrms,4s", "chirp:5-40Hz@50N,4s")
DT = 5e-4
NOISE = 40.0  # dB


def record(folder: Path) -> list[Recording]:
    """The training recording and then the unseen ones."""
    (folder / "stage.mo").write_text(STAGE, encoding="utf-8")
    fmu = build(compile_model(f"{folder / 'stage.mo'}:Stage"), folder / "stage.fmu")
    return [simulate(fmu, spec, dt=DT, noise_snr=NOISE, seed=k) for k, spec in enumerate((TRAIN, *UNSEEN))]


def table(result: Identification) -> str:
    """Force NRMSE, and displacement NRMSE in free run, of every model on the unseen recordings."""
    assert result.hybrid is not None
    lines = [
        "| unseen recording | linear fit | law alone | networks alone | both | in the 90 % band |",
        "|---" * 6 + "|",
    ]
    linear = {c.recording.name: c.linear for c in result.comparisons}
    for spec, pair in zip(UNSEEN, result.hybrid.unseen, strict=True):
        models = (linear[pair.recording.name], pair.physics, pair.network, pair.hybrid)
        cells = [f"{p.force_nrmse:.3f}, " + ("diverged" if p.x_nrmse is None else f"{p.x_nrmse:.3f}") for p in models]
        band = pair.hybrid.within(pair.recording.channel("R"))
        lines.append(f"| {spec} | {' | '.join(cells)} | {band:.2f} |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the example."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=Path("hybrid"))
    folder: Path = parser.parse_args(arguments).out
    folder.mkdir(parents=True, exist_ok=True)
    train, *unseen = record(folder)
    (folder / "known.mo").write_text(KNOWN, encoding="utf-8")
    law = str(folder / "known.mo")
    result = identify([train], mass=1.0, ensemble=10, model=law, holdout=unseen, out=folder / "model")
    assert result.hybrid is not None
    print(table(result), "\n\n", result.hybrid.sentence(), sep="")
    return 0 if result.hybrid.offered else 1


if __name__ == "__main__":
    raise SystemExit(main())
