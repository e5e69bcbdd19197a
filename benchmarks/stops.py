"""Springs with sliders on a measured motion: closed form against located events.

``python -m benchmarks.stops`` prints, for Jenkins and Iwan on 32,000 samples, processor time per sample both ways and
their ratio (medians of 7 rounds in turn). The same model is compiled twice, once without its table of stops.
"""

from __future__ import annotations

import re
import time
from dataclasses import replace

import numpy as np

from hystid.compiled import CompiledModel
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model

SAMPLES, DT, ROUNDS = 32_000, 1e-3, 7
SIZES = {"Jenkins": {"Ks": 5e4, "fc": 20.0}, "Iwan": {"Ks": 5e4, "fc": 25.0}}


def located(code: ModelCode) -> CompiledModel:
    """The same model with every slip and stick as an event."""
    text = re.sub(r" *\.stops = hy_sliders, \.n_stops = \d+,\n", "", code.sources["model.c"])
    text = re.sub(r"static const hy_stop hy_sliders\[\d+\] = \{.*?\};\n", "", text, flags=re.DOTALL)
    assert text != code.sources["model.c"], "the model has no stops"
    return CompiledModel(replace(code, sources={**code.sources, "model.c": text}))


def main() -> None:
    """Print the table."""
    t = DT * np.arange(SAMPLES)
    x = 1e-3 * np.sin(2 * np.pi * 30 * t) * (0.2 + 0.8 * np.sin(2 * np.pi * 0.3 * t) ** 2)
    motion = {"x": x, "v": np.gradient(x, DT)}
    print("law      closed [ns]  located [ns]  ratio")
    for name, sizes in SIZES.items():
        code = compile_model(f"HystId.Oscillators.{name}")
        models = (CompiledModel(code), located(code))
        spent: list[list[float]] = [[], []]
        for _ in range(ROUNDS + 1):  # the first round compiles
            for times, model in zip(spent, models, strict=True):
                begun = time.process_time()
                model.clamp(motion, {}, DT, parameters=sizes, outputs=("R",))
                times.append((time.process_time() - begun) / SAMPLES * 1e9)
        closed, events = (float(np.median(times[1:])) for times in spent)
        print(f"{name:8} {closed:11.0f} {events:13.0f} {events / closed:6.1f}")


if __name__ == "__main__":
    main()
