"""Could anyone know? What a refit hides of a concealed force, and how much of the rest another law would take.

Decided by the generator's own laws along the true motion, never by the engine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.proof.motion import CONCEALED, Array, Motion, Term, follow
from benchmarks.proof.rig import Rig

# Laws that hold another as a special case say nothing against it: the simpler one is the name.
HOLDS = {
    "preload": {"asymmetric_friction", "force_drift"},
    "coulomb_friction": {
        "stribeck_friction",
        "asymmetric_friction",
        "position_dependent_friction",
        "hysteretic_friction",
    },
    "contact_loss": {"impact", "two_sided_stop"},
    "bilinear_stiffness": {"impact", "two_sided_stop"},
    "two_sided_stop": {"impact"},
    "backlash": {"impact"},
}


@dataclass(frozen=True)
class Fairness:
    """``hidden``: rms of the concealed force that no refit of the baseline takes [N]; ``rivals``: id -> share of its
    energy that this other id takes at best."""

    hidden: float
    rivals: dict[str, float]


def judge(
    rig: Rig,
    motions: list[Motion],
    over: int,
    force: list[Array],
    names: set[str],
    beside: list[list[Array]],
    afloat: bool,
) -> Fairness:
    """``motions``: the training tests, ``over`` times oversampled; ``force``: a concealed force on the same grid, which
    ``names`` name rightly; ``beside``: the forces of other concealed laws, which a fit could scale too; ``afloat``: x
    was not measured, so that zero and slow drift of x are anyone's guess in each test."""
    coarse = max(1, over // 2)
    tangent, candidates = [], []
    for motion in motions:
        half = motion.every(coarse)
        keep = slice(0, 2 * ((len(half.t) - 1) // 2) + 1)
        x, v, a = half.x[keep], half.v[keep], half.a[keep]
        h = 2 * (half.t[1] - half.t[0])
        tangent.append(_tangent(rig, h, x, v, a))
        if afloat:
            slow = np.linspace(-1, 1, len(tangent[-1]))[:, None] ** np.arange(2)
            free = [np.zeros_like(slow)] * len(motions)
            free[len(tangent) - 1] = slow
            tangent[-1] = np.hstack([tangent[-1], *free])
        candidates.append(_candidates(rig, h, x, v, a))
    n = max(1, sum(len(c[0]) for c in tangent) // 8000)
    base = np.vstack([c[::n] for c in tangent])
    y = np.concatenate([f[:: 2 * coarse][: len(c)][::n] for f, c in zip(force, tangent, strict=True)])
    for other in beside:
        column = np.concatenate([f[:: 2 * coarse][: len(c)][::n] for f, c in zip(other, tangent, strict=True)])
        base = np.column_stack([base, column])
    base = base[:, np.linalg.norm(base, axis=0) > 0]
    q, _ = np.linalg.qr(base / np.linalg.norm(base, axis=0))
    rest = y - q @ (q.T @ y)
    hidden = float(np.sqrt(np.mean(rest**2)))
    energy = float(rest @ rest) or 1.0
    rivals: dict[str, float] = {}
    silent = names.union(*(HOLDS.get(name, ()) for name in names))
    every = min(candidates, key=len)  # pinching has no column in a recording in which the contact does not slip
    for place, (effect, _) in enumerate(every):
        if effect in silent:
            continue
        columns = np.vstack([c[place][1][::n] for c in candidates])
        if not np.all(np.abs(columns) < 1e100):  # a hidden mode too fast for the step
            continue
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-30)
        columns = columns - q @ (q.T @ columns)
        size = np.linalg.norm(columns, axis=0)
        if np.any(size < 1e-6):  # the refit takes it
            continue
        u, s, _ = np.linalg.svd(columns / size, full_matrices=False)
        u = u[:, s > 1e-6]
        taken = float(np.sum((u.T @ rest) ** 2)) / energy
        rivals[effect] = max(rivals.get(effect, 0.0), taken)
    return Fairness(hidden, dict(sorted(rivals.items(), key=lambda item: -item[1])))


def _tangent(rig: Rig, h: float, x: Array, v: Array, a: Array) -> Array:
    """Change of the baseline's force with each of its parameters along the motion; the mass is weighed."""
    columns = [x[::2], v[::2]]
    for name, value in rig.parameters.items():
        if name in ("m", "B", "Kl"):
            continue
        sides = [follow(rig.terms(**{name: value * q}), 0.0, h, x, v, a).h for q in (1.03, 0.97)]
        columns.append((sides[0] - sides[1]) / (0.06 * max(float(np.std(sides[0])), 1e-30)))
    return np.stack(columns, axis=1)


def _candidates(rig: Rig, h: float, x: Array, v: Array, a: Array) -> list[tuple[str, Array]]:
    """(id, columns) of plain forms of every law, with thresholds from 0.1 to 0.9 of the largest displacement."""
    X, V = rig.X, 2 * np.pi * rig.f0 * rig.X
    xs, vs, s = x[::2] / X, v[::2] / V, np.tanh(v[::2] / (0.01 * V))
    t = np.linspace(0, 1, len(xs))
    whole = follow(rig.terms(), 0.0, h, x, v, a).h
    rms = float(np.std(whole))
    whole = whole / rms if rms > 0 else np.zeros_like(xs)
    path = np.cumsum(np.abs(np.gradient(xs)))

    def law(*terms: Term) -> Array:
        return follow(terms, 0.0, h, x, v, a).f

    def stack(*columns: Array) -> Array:
        return np.stack(columns, axis=1)

    out = [
        ("cubic_stiffness", stack(xs**3, xs**5)),
        ("quadratic_stiffness", stack(xs**2, xs**4)),
        ("preload", stack(np.ones_like(xs))),
        ("bilinear_stiffness", stack(np.abs(xs))),
        ("quadratic_damping", stack(vs * np.abs(vs), vs**3)),
        ("displacement_dependent_damping", stack(xs * vs, xs**2 * vs)),
        ("displacement_dependent_damping", stack(np.abs(xs) * vs)),
        ("coulomb_friction", stack(s)),
        ("asymmetric_friction", stack(s, np.ones_like(xs))),
        ("position_dependent_friction", stack(s, xs * s)),
        ("position_dependent_friction", stack(s, np.abs(xs) * s)),
        ("added_mass", stack(a[::2])),
        ("stiffness_drift", stack(xs * t)),
        ("stiffness_drift", stack(xs * t, xs * t**2)),
        ("force_drift", stack(np.ones_like(xs), t)),
        ("channel_delay", stack(v[::2], np.gradient(a[::2]))),
    ]
    for vd in (0.05, 0.15, 0.4):
        out.append(("stribeck_friction", stack(s, s * np.exp(-((vs / vd) ** 2)))))
        out.append(("stribeck_friction", stack(s, s / (1 + (vs / vd) ** 2))))
    for gap in (0.1, 0.2, 0.35, 0.5, 0.65, 0.8):
        up, down = np.maximum(xs - gap, 0), np.maximum(-xs - gap, 0)
        out += [
            ("contact_loss", stack(up)),
            ("contact_loss", stack(down)),
            ("two_sided_stop", stack(up - down)),
            ("two_sided_stop", stack(up**1.5 - down**1.5)),
            ("two_sided_stop", stack(up, down)),
            ("impact", stack(up, up * vs)),
            ("impact", stack(down, down * vs)),
            ("impact", stack(up - down, (up + down) * vs)),
        ]
    for limit in (0.02, 0.06, 0.12, 0.25, 0.45):
        one = Term("sliders", (1,), CONCEALED, table=((1 / (limit * X), limit * X),))
        smooth = Term("boucwen", (1, 1 / (limit * X), 0.5 / (limit * X), 0.5 / (limit * X), 1.0), CONCEALED)
        out += [("hysteretic_friction", stack(law(one))), ("hysteretic_friction", stack(law(smooth)))]
    for tau in (0.1, 0.5, 2.0, 8.0):
        out.append(("viscoelastic_relaxation", stack(law(Term("maxwell", (1 / X, tau / (2 * np.pi * rig.f0)))))))
    for ratio in (0.5, 0.7, 0.9, 1.1, 1.4, 1.8, 2.3, 3.0):
        for zeta in (0.02, 0.1):
            hidden = law(Term("hidden", (1, 2 * np.pi * rig.f0 * ratio, zeta, 0)))
            out.append(("hidden_mode", stack(hidden / max(float(np.max(np.abs(hidden))), 1e-30))))
    for q in (0.2, 0.5, 1.5):
        wear = 1 - np.exp(-path / (q * path[-1] + 1e-30))
        out.append(("cyclic_degradation", stack((whole if rms > 0 else xs) * wear)))
    if rms > 0:
        out += [("pinching", stack(whole * np.exp(-((xs / w) ** 2)))) for w in (0.1, 0.25, 0.5)]
    return out
