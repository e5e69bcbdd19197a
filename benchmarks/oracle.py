"""Independent simulations for benchmarks: Jenkins and Bouc-Wen oscillators, written by hand, apart from the library.

Runge-Kutta of order 4 with ``substeps`` steps per sample, the spring-slider force clipped at each substep.
"""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np

from hystid import toolchain
from hystid.recording import Recording

_TEXT = r"""
#include <math.h>
typedef struct { double m, B, Kl, Ks, fc, alpha, beta, gamma, delta; } law;
static void rate(const law *p, int bouc, const double *s, double F, double *d) {
    double x = s[0], v = s[1], z = s[2];
    d[0] = v;
    d[1] = (F - p->B * v - p->Kl * x - z) / p->m;
    d[2] = bouc ? p->alpha * v - p->beta * (p->gamma * fabs(v) * z + p->delta * v * fabs(z))
                : (z >= p->fc && v > 0) || (z <= -p->fc && v < 0) ? 0 : p->Ks * v;
}
__attribute__((visibility("default")))
void simulate(const law *p, int bouc, long n, double dt, int substeps, const double *F, double *rows) {
    double s[3] = {0}, k1[3], k2[3], k3[3], k4[3], w[3], h = dt / substeps;
    for (long k = 0; k < n; k++) {
        rate(p, bouc, s, F[k], k1);
        rows[5 * k] = s[0], rows[5 * k + 1] = s[1], rows[5 * k + 2] = k1[1];
        rows[5 * k + 3] = F[k] - p->m * k1[1], rows[5 * k + 4] = s[2];
        if (k + 1 == n) break;
        for (int q = 0; q < substeps; q++) {
            double f0 = F[k] + (F[k + 1] - F[k]) * q / substeps, f1 = F[k] + (F[k + 1] - F[k]) * (q + 1) / substeps;
            rate(p, bouc, s, f0, k1);
            for (int i = 0; i < 3; i++) w[i] = s[i] + 0.5 * h * k1[i];
            rate(p, bouc, w, 0.5 * (f0 + f1), k2);
            for (int i = 0; i < 3; i++) w[i] = s[i] + 0.5 * h * k2[i];
            rate(p, bouc, w, 0.5 * (f0 + f1), k3);
            for (int i = 0; i < 3; i++) w[i] = s[i] + h * k3[i];
            rate(p, bouc, w, f1, k4);
            for (int i = 0; i < 3; i++) s[i] += h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
            if (!bouc) s[2] = fmax(-p->fc, fmin(p->fc, s[2]));
        }
    }
}
"""

JENKINS = dict(m=1.0, B=10.0, Kl=1e4, Ks=5e4, fc=37.5)
BOUC_WEN = dict(m=2.0, B=10.0, Kl=5e4, alpha=5e4, beta=1e3, gamma=0.8, delta=-1.1)  # Noel and Schoukens, 2016


@cache
def _library() -> ctypes.CDLL:
    return ctypes.CDLL(str(toolchain.shared_library({"oracle.c": _TEXT}, main=["oracle.c"])))


def simulate(name: str, force: np.ndarray, dt: float, parameters: dict[str, float], substeps: int = 20) -> Recording:
    """Motion from rest under a sampled force, linear between samples; Bouc-Wen where ``alpha`` is a parameter."""
    names = ("m", "B", "Kl", "Ks", "fc", "alpha", "beta", "gamma", "delta")
    law = np.array([parameters.get(key, 0.0) for key in names])
    force = np.ascontiguousarray(force, dtype=float)
    rows = np.empty((len(force), 5))
    pointer = lambda values: values.ctypes.data_as(ctypes.c_void_p)  # noqa: E731
    _library().simulate(
        pointer(law),
        int("alpha" in parameters),
        ctypes.c_long(len(force)),
        ctypes.c_double(dt),
        substeps,
        pointer(force),
        pointer(rows),
    )
    x, v, a, R, _ = rows.T.copy()
    return Recording(name, np.arange(len(force)) * dt, F=force, x=x, v=v, a=a, R=R)


def noisy(recording: Recording, snr_db: float, rng: np.random.Generator) -> Recording:
    """White noise on F, x, v and a, each at the given signal-to-noise ratio; R is dropped."""
    channels = {}
    for key in ("F", "x", "v", "a"):
        clean = recording.channel(key)
        level = np.sqrt(np.mean(clean**2)) * 10 ** (-snr_db / 20)
        channels[key] = clean + level * rng.standard_normal(len(clean))
    return Recording(recording.name, recording.t, **channels)


def chirps(snr_db: float | None = 34.0, amplitudes=(15, 30, 45, 60, 75, 105), dt: float = 1e-4, seed: int = 1):
    """Training recordings of the reference study: 0 to 100 Hz in 5 s at each force amplitude."""
    t, rng = np.arange(round(5 / dt)) * dt, np.random.default_rng(seed)
    for amplitude in amplitudes:
        force = amplitude * np.sin(2 * np.pi * 10 * t**2)
        clean = simulate(f"chirp_{amplitude}N", force, dt, JENKINS)
        yield clean if snr_db is None else noisy(clean, snr_db, rng)


def harmonics(dt: float = 1e-4, duration: float = 2.0, amplitudes=(80, 90)):
    """Validation recordings: 20, 30, 40, 50 Hz, by default at 80 and 90 N, without noise."""
    t = np.arange(round(duration / dt)) * dt
    for frequency in (20, 30, 40, 50):
        for amplitude in amplitudes:
            yield simulate(
                f"harmonic_{frequency}Hz_{amplitude}N", amplitude * np.sin(2 * np.pi * frequency * t), dt, JENKINS
            )
