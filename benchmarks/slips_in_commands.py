"""Every command on files with each slip: does a wrong label end in a name, in a crash, or in exit code 0?

Run by ``python -m benchmarks.slips --commands``: 400 runs, a quarter of an hour. The rigs and slips are those of
``benchmarks.slips``, the recordings two seconds long; the commands run as on the command line. What a recording cannot
show (see there) is counted apart.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.slips import RIGS, SIMULATED, Slip, simulated, slips
from hystid.cli.run import run
from hystid.consistency import examine
from hystid.recording import Recording, write_csv

COMMANDS = ("check", "identify", "validate", "diagnose")
SHORT = ("multisine:2-80Hz@40Nrms,2s", "chirp:1-60Hz@60N,2s")  # the forces of SIMULATED, with a fourth of the samples
LABELS = ("wrong_unit", "swapped_sign", "swapped_channels", "wrong_mass")  # the others are flaws of a sensor or a clock


@dataclass(frozen=True)
class Outcome:
    """What a command made of a file: exit code, what it printed, and the physics that it named."""

    code: int
    said: str
    named: tuple[str, ...] = ()

    @property
    def crashed(self) -> bool:
        """Whether a defect showed itself, as a traceback or in the one line that stands for it."""
        return "Traceback" in self.said or "internal error" in self.said

    def harmless(self, slip: Slip) -> bool:
        """A label: no exit code 0, and no name but with the label read rightly and that said on top. A flaw of a sensor
        or a clock: said; and a late force has no name."""
        if self.crashed:
            return False
        mended = not self.named or "to be mended: " in self.said
        if slip.rule in LABELS:
            return self.code != 0 and mended
        return (f"[{slip.rule}]" in self.said or self.code == 2) and (mended or slip.rule != "lag")


def outcome(command: str, file: Path, mass: float, folder: Path) -> Outcome:
    """Run one command on a file. folder: holds ``surrogate.onnx``, and gets the results."""
    out = folder / "out"
    arguments = {
        "check": ["--mass", repr(mass)],
        "identify": ["--mass", repr(mass), "--layers", "2", "--ensemble", "1", "--method", "published", "-o", str(out)],
        "validate": ["--mass", repr(mass), "-o", str(out)],
        "diagnose": ["--model", "HystId.Oscillators.Linear", "--set", f"m={mass!r}", "-o", str(out)],
    }
    files = [str(folder / "surrogate.onnx"), str(file)] if command == "validate" else [str(file)]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        code = run([command, *files, *arguments[command]])
    named: tuple[str, ...] = ()
    if command == "diagnose" and (answer := out / "diagnosis.json").exists():
        found = json.loads(answer.read_text(encoding="utf-8"))
        named = tuple(f["effect"] for f in found["findings"]) if found["verdict"] == "missing_physics" else ()
        answer.unlink()
    return Outcome(code, printed.getvalue(), named)


@contextlib.contextmanager
def prepared(recording: Recording, mass: float) -> Iterator[Path]:
    """A folder with the recording as it should be, and a surrogate of it."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_csv(recording, folder / "sound.csv")
        made = outcome("identify", folder / "sound.csv", mass, folder)
        assert made.code == 0, made.said
        for name in ("surrogate.onnx", "oscillator.fmu", "identification.json"):
            (folder / "out" / name).rename(folder / name)
        yield folder


def measure_commands(show: bool) -> None:
    """Print per slip and command how many files ended well."""
    harmless = {slip.name: dict.fromkeys(COMMANDS, 0) for slip in slips()}
    hidden = dict.fromkeys(harmless, 0)
    for name, force, snr in SIMULATED:
        recording, mass = simulated(name, SHORT[force], snr), RIGS[name]["m"]
        told, before = examine([recording], mass).examined[0].undecided, _sum(harmless)
        with prepared(recording, mass) as folder:
            for slip in slips():
                file = folder / "slip.csv"
                write_csv(slip.make(recording), file)
                wrong = 0
                for command in COMMANDS:
                    found = outcome(command, file, mass * slip.mass, folder)
                    well = found.harmless(slip)
                    harmless[slip.name][command] += well
                    wrong += not well
                    if show and not well:
                        print(f"{command}: {slip.name} on {name}: {found.code} {found.named} {found.said[-300:]}")
                hidden[slip.name] += bool(wrong and slip.undecided(told))
        print(f"{name}: {_sum(harmless) - before} of {len(harmless) * len(COMMANDS)} runs ended well", flush=True)
    print(f"| slip | {' | '.join(COMMANDS)} | said beforehand not to show |\n|---|{'---|' * 5}")
    for name, counts in harmless.items():
        cells = " | ".join(f"{counts[command]} of {len(SIMULATED)}" for command in COMMANDS)
        print(f"| {name} | {cells} | {hidden[name] or ''} |")
    total = len(harmless) * len(SIMULATED) * len(COMMANDS)
    print(f"runs that ended well: {_sum(harmless)} of {total}")


def _sum(counts: dict[str, dict[str, int]]) -> int:
    return sum(sum(row.values()) for row in counts.values())
