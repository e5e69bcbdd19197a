"""hystid's kernel as a peer of the shared training benchmark: put it beside its ``common.py``, or set LM_BENCH.

LM_BENCH=../shared/bench/lm LM_TASK=task.npz python peer_hystid.py [trainlm|fast] [float64|float32] SEED ITERS TMAX
"""

import os
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, os.environ.get("LM_BENCH", str(Path(__file__).resolve().parent)))

from common import main

from hystid.networks import training
from hystid.networks.normal_equations import normal_equations

options = [argument for argument in sys.argv[1:] if not argument[0].isdigit()]
sys.argv[1:] = [argument for argument in sys.argv[1:] if argument[0].isdigit()]
MODE = next((option for option in options if option in training.RULES), "fast")
PRECISION = next((option for option in options if option.startswith("float")), "float64")


def run(task, w0, iters, tmax, rec):
    """Train on the task, one recorded iterate per iteration."""
    fit = normal_equations((3, 5, 5, 1), task["xtr"].T, task["ytr"], PRECISION)
    fit.build(w0)
    rec.start()
    rec.add(w0, 0)
    rule, w, mu = replace(training.RULES[MODE], max_iterations=1), w0, training.RULES[MODE].mu
    for k in range(1, iters + 1):
        moved, mu, _ = training._step(fit, w, mu, rule)
        if moved is None:
            break
        w = moved
        rec.add(w, k)
        if rec.elapsed() > tmax:
            break


main(run, f"hystid-{MODE}-{PRECISION}")
