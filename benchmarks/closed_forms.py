"""Rate-independent laws on a measured motion: followed along their way, against integrated and located.

``python -m benchmarks.closed_forms`` prints, for each law on 32,000 samples, processor time per sample both ways and
their ratio (medians of 7 rounds in turn), and the largest error of either, as a share of the force, against 100 steps
per sample. The same model is compiled twice, once without its tables of stops and rate-independent states.
"""

from __future__ import annotations

import re
import time
from dataclasses import replace

import numpy as np

from hystid.compiled import CompiledModel
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model

SAMPLES, DT, ROUNDS, FINE = 32_000, 1e-3, 7, 100
SIZES = {
    "Jenkins": {"Ks": 5e4, "fc": 20.0},
    "Iwan": {"Ks": 5e4, "fc": 25.0},
    "BoucWen": {"alpha": 5e4, "beta": 30.0, "gamma": 0.8, "delta": -0.5, "nu": 1.5},
    "Dahl": {},
    "MicroSlip": {},
}
_TABLES = {"stops": "hy_stop hy_sliders", "duhem": "hy_duhem_state hy_rate_independent"}


def integrated(code: ModelCode) -> CompiledModel:
    """The same model in steps of time, with every slip and stick as an event."""
    text = code.sources["model.c"]
    for field, table in _TABLES.items():
        text = re.sub(rf" *\.{field} = \w+, \.n_{field} = \d+,.*\n", "", text)
        text = re.sub(rf"static const {table}\[\d+\] = \{{.*?\}};\n", "", text, flags=re.DOTALL)
    assert text != code.sources["model.c"], "the model has no closed form"
    return CompiledModel(replace(code, sources={**code.sources, "model.c": text}))


def main() -> None:
    """Print the table."""
    t = DT * np.arange(SAMPLES)
    x = 1e-3 * np.sin(2 * np.pi * 30 * t) * (0.2 + 0.8 * np.sin(2 * np.pi * 0.3 * t) ** 2)
    motion = {"x": x, "v": np.gradient(x, DT)}
    print("law        followed [ns]  integrated [ns]  ratio  error followed  error integrated")
    for name, sizes in SIZES.items():
        code = compile_model(f"HystId.Oscillators.{name}")
        models = (CompiledModel(code), integrated(code))
        spent: list[list[float]] = [[], []]
        for _ in range(ROUNDS + 1):  # the first round compiles
            for times, model in zip(spent, models, strict=True):
                begun = time.process_time()
                model.clamp(motion, {}, DT, parameters=sizes, outputs=("R",))
                times.append((time.process_time() - begun) / SAMPLES * 1e9)
        followed, steps = (float(np.median(times[1:])) for times in spent)
        fine = models[1].clamp(motion, {}, DT, parameters=sizes, outputs=("f_h",), substeps=FINE)["f_h"]
        forces = [model.clamp(motion, {}, DT, parameters=sizes, outputs=("f_h",))["f_h"] for model in models]
        errors = [float(np.max(np.abs(force - fine)) / np.max(np.abs(fine))) for force in forces]
        print(f"{name:10} {followed:13.0f} {steps:16.0f} {steps / followed:6.1f} {errors[0]:15.1e} {errors[1]:17.1e}")


if __name__ == "__main__":
    main()
