"""``identify``: from recordings to a two-network model, its errors and its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hystid import processing
from hystid.comparison import mse, nrmse
from hystid.consistency import admit
from hystid.errors import UsageError
from hystid.identification import data
from hystid.identification.dissipation import feeding
from hystid.identification.hybrid.fit import combine
from hystid.identification.hybrid.law import Law, law_of
from hystid.identification.inputs import check_lags, check_range, resolve, unused_columns
from hystid.identification.lags import choose_lags
from hystid.identification.leftout import LeftOut
from hystid.identification.levels import with_curves
from hystid.identification.methods import Plan, Recipe, Trained
from hystid.identification.offsets import constant_and_even
from hystid.identification.prediction import Prediction, Role, drift, predict
from hystid.identification.result import Comparison, Identification
from hystid.networks import Lag, TwoNetworkModel
from hystid.networks.ensemble import workers_of
from hystid.networks.normal_equations import Precision
from hystid.networks.training import Mode, draw, rule_of, split_indices
from hystid.networks.trust import Tail
from hystid.recording import Recording, Sources, check_together, loaded
from hystid.turning_points import TurningPoints

Method = Literal["published", "refined"]


def identify(
    recordings: Sources,
    *,
    mass: float,
    layers: Sequence[int] = (5, 5),
    ensemble: int = 30,
    band: processing.Band | None = None,
    decimate: int = 1,
    seed: int = 0,
    mode: Mode = "fast",
    method: Method = "refined",
    precision: Precision = "float64",
    samples: int = 50_000,
    holdout: Sources = (),
    inputs: Sequence[str] = (),
    lags: Sequence[Lag] | None = None,
    model: str | None = None,
    workers: int | None = None,
    device: str | None = None,
    out: Path | None = None,
) -> Identification:
    """Identify the restoring force with memory from recordings, by the two-network method.

    recordings: the training set; holdout: recordings that are only predicted; in memory or as files. Both go through
    ``processing.prepare`` with ``band`` (low, high) [Hz] and ``decimate``, so that x, v and R = F - mass a are there.
    Sample rates may differ: the memory knows no time, lags are followed at each recording's own; files get the highest.
    mass [kg]: 0 means that F is the restoring force itself; then there is no free run. A recording with a column
    ``mass`` of one value (``hystid.recording.with_column``) has its own; the files carry ``mass``.
    layers: neurons of each hidden layer of both networks. ensemble: number of starts; the best tenth is averaged.
    seed: of the split and of all starts; the result does not depend on ``workers`` (trainings at a time).
    mode: "trainlm" (MATLAB's damping) or "fast" (Marquardt's).
    method: "published" trains each network by itself on the channels as they are. "refined" (default) smooths x, v and
    a jointly, and goes on from the best third of the starts with both networks trained together in simulation; the
    published model is then trained as well and stands beside it in every comparison. It is returned in its place where
    the refined one runs worse in closed loop on the training recordings; ``notes`` then says so.
    inputs: columns of the recordings that both networks see besides the motion, as a current or a pressure; each needs
    a known unit. A value that was not recorded: ``hystid.recording.with_column``.
    lags: signals that both networks see late (``Lag``), as the current of a coil that follows its voltage. None: those
    that left-out stretches ask for (method "refined"), mostly none.
    model: a rig in Modelica ("HystId.Oscillators.Jenkins", "rig.mo:Rig", the folder that ``diagnose`` wrote) whose
    law is fitted together with networks for what it leaves (``Identification.hybrid``); needs ``holdout``. It is
    written as hybrid.mo and hybrid.fmu where it beats law and networks alone there, else ``notes`` says why not.
    samples: at most so many, drawn at random from all recordings after the turning points were found at full rate.
    device: a torch device such as "cuda" for the first trainings, all starts at once; None uses the compiled kernel.
    out: folder to write the models and identification.json to.
    Raises UsageError, RecordingError, NumericalError. After Ctrl-C it goes on with the trainings that had finished.

    >>> import hystid
    >>> fmu = hystid.build("HystId.Oscillators.Jenkins", "jenkins.fmu")
    >>> sweep = hystid.simulate(fmu, "chirp:0-60Hz@60N,2s", dt=4e-4, noise_snr=40)
    >>> model = hystid.identify(sweep, mass=1.0, ensemble=2, method="published", workers=1)
    >>> model.comparisons[0].network.force_nrmse < model.comparisons[0].linear.force_nrmse
    True
    >>> sorted(file.name for file in model.save("model").iterdir() if file.suffix == ".fmu")
    ['oscillator.fmu', 'surrogate.fmu']
    """
    _check(mass, layers, method)
    data.check_counts(ensemble, samples, seed, workers, "ensemble")
    law = _law(model, mass, holdout)
    recordings, holdout = loaded(recordings), loaded(holdout)
    check_together(recordings, holdout)
    recordings, holdout = (admit(group, mass) for group in (recordings, holdout))
    ports = resolve([*recordings, *holdout], inputs)
    law = law.beside([*recordings, *holdout], ports) if law else None
    check_range(recordings, ports)
    check_lags(lags or (), ports)
    recipe = Recipe(band, decimate, mass, smoothing=method == "refined")
    used, unseen = ([recipe.apply(recording) for recording in group] for group in (recordings, holdout))
    data.check(used, unseen)
    plain_ports = ports
    if method == "refined":
        ports = with_curves(used, ports)
    leftout = LeftOut(used, ports, seed)
    if lags is None:
        lags = choose_lags(leftout) if method == "refined" else ()
    plan = Plan(
        mass, tuple(layers), ensemble, seed, rule_of(mode), precision, samples, workers, device, ports, tuple(lags)
    )
    if ports and method == "refined":
        plan = replace(plan, level=data.level_of(used, ports, lags))
    trained = plan.refined(used) if method == "refined" else plan.published(used)
    plain_samples = data.samples(used, TurningPoints(), plain_ports)
    tail = data.tail_of(plain_samples)
    networks = _model(trained, used, plan, tail)
    networks = replace(networks, spread=leftout.spread(networks, trained.unseen))
    fit = data.linear_fit(plain_samples, mass)
    models = {"network": networks, "linear": data.linear_model(fit, networks.sample_rate, plain_ports)}
    if method == "refined":
        raw = [replace(recipe, smoothing=False).apply(recording) for recording in recordings]
        unaided = replace(plan, lags=(), level=None, inputs=plain_ports)
        plain = unaided.published(raw)
        models["published"] = _model(plain, raw, unaided, tail)
    comparisons = _compared(models, used, unseen, workers)
    if method == "refined" and (why := _unsteady(comparisons)):
        trained = replace(plain, notes=(*plain.notes, why))
        networks = models["published"]
        networks = replace(networks, spread=LeftOut(used, plain_ports, seed).spread(networks, None))
        comparisons = [replace(item, network=predict(networks, item.recording), published=None) for item in comparisons]
    if method == "refined":
        raw = [replace(recipe, smoothing=False).apply(recording) for recording in (*recordings, *holdout)]
        comparisons = [
            replace(item, recorded=predict(networks, recording))
            for item, recording in zip(comparisons, raw, strict=True)
        ]
    settings: dict[str, Any] = {"layers": list(layers), "ensemble": ensemble, "mode": mode, "method": method}
    settings |= {"seed": seed, "samples": len(trained.samples.x), "precision": precision, "decimate": decimate}
    settings["band"] = list(band) if band else None
    late = tuple(
        f"the force follows {lag.source} late: a lag of {1e3 * lag.time:.3g} ms is a further input of the networks"
        for lag in networks.lags
    )
    notes = (
        *trained.notes,
        *late,
        *feeding(networks, used),
        *leftout.two_levels(),
        *constant_and_even(used, ports),
        *unused_columns([c.recording for c in comparisons], [c.network.R for c in comparisons], ports),
    )
    hybrid = combine(law, replace(plan, inputs=plain_ports), comparisons, networks.training_range) if law else None
    if hybrid:
        notes = (*notes, hybrid.sentence(), *hybrid.notes)
    numbers = tuple(start.number for start in trained.chosen)
    test = _test(comparisons, samples, seed)
    result = Identification(networks, trained.starts, numbers, comparisons, fit, test, settings, notes, hybrid=hybrid)
    return result.written(Path(out)) if out is not None else result


def _law(model: str | None, mass: float, holdout: Sources) -> Law | None:
    """The physics of a hybrid, compiled before any training; None where none is wanted."""
    if model is None:
        return None
    if not holdout:
        raise UsageError(
            f"--model {model}: hold out at least one recording (--holdout): physics plus network is only offered where "
            "it beats each alone on recordings that neither has seen"
        )
    return law_of(model, mass)


def _model(trained: Trained, recordings: Sequence[Recording], plan: Plan, tail: Tail) -> TwoNetworkModel:
    limits = data.limits_of(recordings, plan.inputs)
    rate = max(recording.sample_rate for recording in recordings)
    model = plan.model([start.member for start in trained.chosen], rate, limits)
    turns = {"rotational": True} if recordings[0].rotational else {}
    return replace(model, metadata={**trained.metadata, **turns}, tail=tail)


def _compared(
    models: Mapping[str, TwoNetworkModel],
    training: Sequence[Recording],
    unseen: Sequence[Recording],
    workers: int | None,
) -> list[Comparison]:
    """Every model on every recording, side by side: the work is in compiled code that runs beside Python."""
    roles: list[tuple[Recording, Role]] = [(r, "training") for r in training]
    roles += [(r, "holdout") for r in unseen]
    with ThreadPoolExecutor(workers_of(workers)) as pool:
        found = {name: pool.map(partial(predict, model), [r for r, _ in roles]) for name, model in models.items()}
        answers = {name: list(each) for name, each in found.items()}
    return [
        Comparison(recording, role, **{name: each[k] for name, each in answers.items()})
        for k, (recording, role) in enumerate(roles)
    ]


def _unsteady(comparisons: Sequence[Comparison]) -> str:
    """Why the refined model is not to be used, "" where it is: judged by free runs of the training recordings alone.

    A closer fit of the force need not run better: without a spring, small errors of the force add up to any motion.
    """
    training = [item for item in comparisons if item.role == "training"]
    refined = float(np.median([drift(item.network) for item in training]))
    plain = float(np.median([drift(_given(item.published)) for item in training]))
    if refined <= plain:
        return ""
    return (
        f"the refined networks run worse in closed loop on the training recordings (displacement NRMSE {refined:.3g} "
        f"against {plain:.3g}), so those of the published method are returned"
    )


def _given(prediction: Prediction | None) -> Prediction:
    assert prediction is not None  # the refined method trains the published one beside it
    return prediction


def _check(mass: float, layers: Sequence[int], method: str) -> None:
    if not (isinstance(mass, Real) and 0 <= mass < np.inf):
        raise UsageError(f"mass must be a number of at least 0 kg, found {mass!r}")
    whole = isinstance(layers, Sequence) and all(isinstance(neurons, Integral) for neurons in layers)
    if not (whole and layers and min(layers) >= 1):
        raise UsageError(f"layers must be neurons per hidden layer, each at least 1, as 5,5; found {layers!r}")
    if method not in ("published", "refined"):
        raise UsageError(f"method must be 'published' or 'refined', found {method!r}")


def _test(comparisons: Sequence[Comparison], samples: int, seed: int) -> dict[str, float]:
    """Errors of the model's own simulation on the test part of the split."""
    training = [comparison for comparison in comparisons if comparison.role == "training"]
    reference = np.concatenate([comparison.recording.channel("R") for comparison in training])
    force = np.concatenate([comparison.network.R for comparison in training])
    drawn = draw(len(reference), samples, seed)
    part = drawn[split_indices(len(drawn), seed)["test"]]
    return {
        "nrmse": nrmse(force[part], reference[part]),
        "mse": mse(force[part], reference[part]),
        "samples": len(part),
    }
