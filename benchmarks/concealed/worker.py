"""Diagnose one case in a process of its own: ``benchmarks.concealed.worker CASE OUT [--exclude id,..] [--limit S]``.

It sees a copy of the case folder and nothing else of the deck. The last line that it prints is a JSON object with the
processor time of the diagnosis [s], imports left out.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("case", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--exclude", default="")
    parser.add_argument("--limit", type=int, default=600)
    chosen = parser.parse_args()
    from hystid.diagnosis import diagnose

    resource.setrlimit(resource.RLIMIT_CPU, (chosen.limit, chosen.limit + 5))
    handed = json.loads((chosen.case / "case.json").read_text(encoding="utf-8"))
    options = {"exclude": tuple(chosen.exclude.split(","))} if chosen.exclude else {}
    start = time.process_time()
    diagnose(
        [chosen.case / name for name in handed["recordings"]],
        model=handed["model"],
        parameters=chosen.case / handed["parameters"],
        holdout=[chosen.case / name for name in handed["holdout"]],
        out=chosen.out,
        **options,
    )
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps({"cpu_s": time.process_time() - start, "memory_MB": memory}))


if __name__ == "__main__":
    main()
