"""What it would cost to take the graph algorithms of the compiler from networkx.

    python -m benchmarks.graph_library [MODEL ...]

Strongly connected components by networkx in place of ``hystid.modelica.blocks.components``; the assignment of equations
to unknowns stays, since that of networkx knows no wishes. Builds of an FMU, in turn, each in a process of its own: cold
(an empty cache) and again (all that is compiled is in the cache). Printed: median seconds, and the ratio. networkx
comes with torch (the extra ``train``).
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROUNDS = 7

BUILD = """
import sys
import hystid
if sys.argv[1] == "networkx":
    import networkx
    from hystid.modelica import blocks

    def components(graph):
        kept = {node: [other for other in others if other in graph] for node, others in graph.items()}
        return [list(found) for found in networkx.strongly_connected_components(networkx.DiGraph(kept))]

    blocks.components = components
hystid.build(*sys.argv[2:])
"""


def seconds(kind: str, model: str, cache: Path, out: Path) -> float:
    """Wall time of one build in a process of its own."""
    begin = time.perf_counter()
    environment = {**os.environ, "HYSTID_CACHE": str(cache)}
    subprocess.run([sys.executable, "-c", BUILD, kind, model, str(out)], env=environment, check=True)
    return time.perf_counter() - begin


def main(models: list[str]) -> None:
    """Print a row per model."""
    for model in models:
        cold: dict[str, list[float]] = {"own": [], "networkx": []}
        again: dict[str, list[float]] = {"own": [], "networkx": []}
        for _ in range(ROUNDS):
            for kind in cold:
                with tempfile.TemporaryDirectory() as folder:
                    cache = Path(folder) / "cache"
                    cold[kind].append(seconds(kind, model, cache, Path(folder) / "cold.fmu"))
                    again[kind].append(seconds(kind, model, cache, Path(folder) / "again.fmu"))
        for name, times in (("cold", cold), ("again", again)):
            own, other = (statistics.median(times[kind]) for kind in ("own", "networkx"))
            print(f"{model} {name}: own {own:.2f} s, networkx {other:.2f} s, ratio {other / own:.2f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or ["HystId.Oscillators.Jenkins"])
