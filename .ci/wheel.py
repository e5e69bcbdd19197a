"""Build the wheel, install it in an empty environment, and use it there, away from the sources.

What a user gets is the wheel: without the extras, without the repository beside it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PIP = ("-m", "pip", "--quiet", "--disable-pip-version-check")
COMMANDS = (
    "--version",
    "build HystId.Oscillators.Jenkins -o jenkins.fmu",
    "regress jenkins.fmu",
    "simulate jenkins.fmu --force chirp:1-40Hz@20N,2s --dt 1e-3 --noise-snr 40 -o a.csv",
    "simulate jenkins.fmu --force chirp:1-40Hz@60N,2s --dt 1e-3 --noise-snr 40 --seed 1 -o b.csv",
    "identify a.csv b.csv --mass 1 --ensemble 2 --method published -o model",
    "validate model/surrogate.fmu --against jenkins.fmu --force harmonic:12Hz@40N,1s --dt 1e-3 -o check",
    "diagnose a.csv b.csv --model HystId.Oscillators.Linear --set m=1 -o why",
)
FOUND = 1  # exit code of a diagnosis that found something, as it must here


def run(*command: str | Path, folder: Path, expected: int = 0) -> None:
    """Run a command and stop with its words where the exit code is another."""
    print("$", *command, flush=True)
    # Nothing of the caller's Python: the environment must do by itself.
    clean = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run([str(part) for part in command], cwd=folder, env=clean, check=False)
    if done.returncode != expected:
        sys.exit(f"exit code {done.returncode}, expected {expected}: {' '.join(map(str, command))}")


def main() -> None:
    """Build, install, use."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(sys.executable, *PIP, "wheel", ROOT, "--no-deps", "-w", folder / "dist", folder=folder)
        (wheel,) = (folder / "dist").glob("hystid-*.whl")
        venv.create(folder / "empty", with_pip=True)
        programs = folder / "empty" / ("Scripts" if os.name == "nt" else "bin")
        run(programs / "python", *PIP, "install", "-c", ROOT / "constraints.txt", wheel, folder=folder)
        work = folder / "work"
        work.mkdir()
        for command in COMMANDS:
            run(programs / "hystid", *command.split(), folder=work, expected=FOUND if "diagnose" in command else 0)
        code = (
            "import hystid, pathlib; root = pathlib.Path(hystid.__file__).parent; assert (root / 'py.typed').exists()"
        )
        run(programs / "python", "-c", f"{code}; print(hystid.diagnose, root)", folder=work)
        print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB, works in an empty environment")


if __name__ == "__main__":
    main()
