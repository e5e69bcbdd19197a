"""The diagnosis of one case, in a process of its own: ``python -m benchmarks.proof.answer CASE_FOLDER [drop]``.

Prints one JSON object: the answer, or why there is none, and the processor time of the diagnosis alone. With ``drop``
the held-out recordings stay away.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any


def ask(folder: Path, drop: bool) -> dict[str, Any]:
    """What ``hystid.diagnosis.diagnose`` says to the files of one folder."""
    from hystid.diagnosis import diagnose
    from hystid.errors import HystidError
    from hystid.recording import read

    question = json.loads((folder / "question.json").read_text())
    training = sorted(folder.glob("train_*.csv"))
    held = [] if drop else sorted(folder.glob("hold_*.csv"))
    began = time.process_time()
    out: dict[str, Any] = {}
    try:
        if question.get("resample"):
            training = [read(path, resample=True) for path in training]
        found = diagnose(training, model=question["model"], parameters=question["parameters"], holdout=held)
        out["answer"] = found.as_dict()
    except HystidError as reason:
        out["refused"] = f"{type(reason).__name__}: {reason}"
    except Exception as reason:  # a crash is a result of the proof too
        out["crashed"] = f"{type(reason).__name__}: {reason}"
    return out | {"cpu": time.process_time() - began}


def asked(folder: Path, drop: bool = False) -> dict[str, Any]:
    """The same in a process of its own; one that dies has crashed."""
    command = [sys.executable, "-m", "benchmarks.proof.answer", str(folder), *(["drop"] if drop else [])]
    ran = subprocess.run(command, capture_output=True, text=True)
    lines = ran.stdout.strip().splitlines()
    if ran.returncode or not lines:
        return {"crashed": ran.stderr.strip()[-400:] or "no answer", "cpu": None}
    return json.loads(lines[-1])


if __name__ == "__main__":
    print(json.dumps(ask(Path(sys.argv[1]), "drop" in sys.argv[2:]), default=float))
