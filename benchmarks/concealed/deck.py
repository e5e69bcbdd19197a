"""Which cases a deck holds: a reproducible list of specifications for a seed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from benchmarks.concealed.chain import DECOYS
from benchmarks.concealed.effects import NEEDS_LOOP, PHYSICS
from benchmarks.concealed.outsiders import RELATIVES, STRANGERS

Item = TypeVar("Item")

SENSORS = ("channel_delay", "force_gain", "force_drift", "sensor_saturation")
FAMILIES = ("linear", "jenkins", "boucwen", "iwan", "pecorari")
HARD = ("snr28", "x_and_F", "two_recordings", "mass_off")
VARIANTS = ("standard", "snr40", "snr28", "x_and_F", "two_recordings", "mass_off", "running")
PAIRS = (
    ("cubic_stiffness", "coulomb_friction"),
    ("contact_loss", "quadratic_damping"),
    ("quadratic_stiffness", "hysteretic_friction"),
    ("preload", "two_sided_stop"),
    ("impact", "coulomb_friction"),
    ("viscoelastic_relaxation", "cubic_stiffness"),
    ("stiffness_drift", "bilinear_stiffness"),
    ("hidden_mode", "position_dependent_friction"),
    ("force_gain", "quadratic_stiffness"),
    ("channel_delay", "cubic_stiffness"),
    ("contact_loss", "coulomb_friction"),
    ("stribeck_friction", "preload"),
)
WRONG_BASELINES = (
    ("boucwen", "linear"),
    ("jenkins", "linear"),
    ("iwan", "linear"),
    ("iwan", "jenkins"),
    ("boucwen", "jenkins"),
    ("jenkins", "boucwen"),
)
PART_TIME = (
    "coulomb_friction",
    "contact_loss",
    "cubic_stiffness",
    "quadratic_damping",
    "quadratic_stiffness",
    "impact",
)


@dataclass(frozen=True)
class CaseSpec:
    """One case to draw. group: single, null, decoy, pair, part_time, wrong_baseline, stranger, relative.

    ids: what is concealed; family: true baseline; given: baseline handed to the diagnosis; variant: of VARIANTS.
    """

    group: str
    ids: tuple[str, ...]
    family: str
    given: str
    variant: str = "standard"


def deck(seed: int, cases: int, only: Sequence[str] = (), variants: Sequence[str] = ()) -> list[CaseSpec]:
    """The specifications of a deck.

    only: ids, groups or baseline families to keep. variants: used in turn, else standard.

    Raises ValueError where nothing bears a chosen name.
    """
    rng = np.random.default_rng([seed, 1])
    chosen: list[CaseSpec] = []
    while len(chosen) < cases:
        wave = [spec for spec in _wave(rng) if _wanted(spec, only)]
        if not wave:
            raise ValueError(f"nothing in the deck is called {', '.join(only)}: use ids, groups or families")
        chosen += wave
    mixed = list(variants) or ["standard"]
    specs = [replace(spec, variant=mixed[i % len(mixed)]) for i, spec in enumerate(chosen[:cases])]
    return specs


def _wanted(spec: CaseSpec, only: Sequence[str]) -> bool:
    return not only or bool({spec.group, spec.family, *spec.ids} & set(only))


def _wave(rng: np.random.Generator) -> Iterable[CaseSpec]:
    """About 51 cases in random order: every id once, a null per baseline, and a share of everything else."""

    def family(ids: tuple[str, ...]) -> str:
        return str(
            rng.choice(FAMILIES[1:4] if NEEDS_LOOP & set(ids) else FAMILIES, p=None if NEEDS_LOOP & set(ids) else _ODDS)
        )

    specs = [_spec("single", (name,), family((name,))) for name in (*PHYSICS, *SENSORS)]
    specs += [_spec("null", (), name) for name in FAMILIES]
    specs += [_spec("decoy", (name,), family(())) for name in DECOYS]
    specs += [_spec("pair", pair, family(pair)) for pair in _some(rng, PAIRS, 4)]
    specs += [_spec("part_time", (name,), family((name,))) for name in _some(rng, PART_TIME, 2)]
    specs += [CaseSpec("wrong_baseline", (), *pair) for pair in _some(rng, WRONG_BASELINES, 2)]
    specs += [_spec("stranger", (name,), family(())) for name in _some(rng, tuple(STRANGERS), 5)]
    specs += [_spec("relative", (name,), family(())) for name in _some(rng, tuple(RELATIVES), 3)]
    return [specs[i] for i in rng.permutation(len(specs))]


_ODDS = (0.25, 0.25, 0.2, 0.2, 0.1)


def _spec(group: str, ids: tuple[str, ...], family: str) -> CaseSpec:
    return CaseSpec(group, ids, family, family)


def _some(rng: np.random.Generator, items: Sequence[Item], count: int) -> list[Item]:
    return [items[i] for i in rng.permutation(len(items))[:count]]
