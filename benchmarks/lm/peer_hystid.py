"""hystid's kernel as a peer of the shared training benchmark: put it beside its ``common.py``, or set LM_BENCH.

LM_BENCH=../shared/bench/lm LM_TASK=task.npz python peer_hystid.py [trainlm|fast] [float64|float32] SEED ITERS TMAX
"""

import os
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, os.environ.get("LM_BENCH", str(Path(__file__).resolve().parent)))

import numpy as np
from common import main

from hystid.leastsquares import minimise
from hystid.networks import training
from hystid.networks.normal_equations import CompiledNormal, One

options = [argument for argument in sys.argv[1:] if not argument[0].isdigit()]
sys.argv[1:] = [argument for argument in sys.argv[1:] if argument[0].isdigit()]
MODE = next((option for option in options if option in training.RULES), "fast")
PRECISION = next((option for option in options if option.startswith("float")), "float64")


class Watcher:
    """Stands where the validation error is asked for, once per iteration: hands the iterate on, and calls it better."""

    samples = 1

    def __init__(self, seen):
        self.seen, self.count = seen, -1

    def squares(self, w):
        self.count += 1
        self.seen(w[0].copy(), self.count)
        return np.full(len(w), -float(self.count))


def run(task, w0, iters, tmax, rec):
    """Train on the task, one recorded iterate per iteration."""
    fit = One(CompiledNormal((3, 5, 5, 1), task["xtr"].T, task["ytr"], PRECISION))
    fit.build(w0[None])
    rec.start()
    rule = replace(training.RULES[MODE], max_iterations=iters, progress=0.0)
    minimise(fit, Watcher(rec.add), np.array(w0)[None], rule, lambda: rec.elapsed() > tmax)


main(run, f"hystid-{MODE}-{PRECISION}")
