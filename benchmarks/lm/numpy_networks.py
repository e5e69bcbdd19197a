"""The networks in NumPy, written apart from the compiled kernels: what these are compared with."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from hystid.networks.normal_equations import parameter_count, unflatten


def response(ensemble, x, v, further, state):
    """As ``evaluation.response``."""
    state, force, each = state.copy(), np.empty(len(x)), np.empty((len(x), len(ensemble.members)))
    stepper = _Stepper(ensemble, state)
    for k in range(len(x)):
        force[k], each[k] = stepper.accept(x[k], v[k], further[k])
    return force, each, state


def free_run(ensemble, force, further, start):
    """As ``evaluation.free_run``, of motions that stay finite."""
    rows = {name: np.zeros(len(force)) for name in ("x", "v", "a", "R")}
    rows["x"][0], rows["v"][0] = start.x, start.v
    stepper = _Stepper(ensemble, start.state.copy())
    x, v, a, R = (rows[name] for name in ("x", "v", "a", "R"))
    mass, dt = start.mass, start.dt
    for k in range(len(force)):
        R[k], _ = stepper.accept(x[k], v[k], further[k])
        a[k] = (force[k] - R[k]) / mass
        if k + 1 == len(force):
            break
        middle, between = 0.5 * (force[k] + force[k + 1]), 0.5 * (further[k] + further[k + 1])
        v1, a1 = v[k], a[k]
        v2 = v1 + 0.5 * dt * a1
        a2 = (middle - stepper.between(x[k] + 0.5 * dt * v1, v2, between)) / mass
        v3 = v1 + 0.5 * dt * a2
        a3 = (middle - stepper.between(x[k] + 0.5 * dt * v2, v3, between)) / mass
        v4 = v1 + dt * a3
        a4 = (force[k + 1] - stepper.between(x[k] + dt * v3, v4, further[k + 1])) / mass
        x[k + 1] = x[k] + dt / 6 * (v1 + 2 * (v2 + v3) + v4)
        v[k + 1] = v1 + dt / 6 * (a1 + 2 * (a2 + a3) + a4)
    return rows


class _Stepper:
    """One ensemble in NumPy, step by step; ``state`` is changed in place."""

    def __init__(self, ensemble, state):
        members = len(ensemble.members)
        self.ensemble, self.memory = ensemble, state[:2]
        self.latest, self.held = state[2 : 2 + members], state[2 + members : 2 + 2 * members]
        self.late = state[2 + 2 * members :]

    def evaluate(self, x, v, further):
        """Each member's R and Rh with the memory as it stands."""
        x, v, further, beyond = _seen(self.ensemble, x, v, further)
        x0, members = self.memory[1], self.ensemble.members
        further = np.concatenate([further, self.late])
        hysteretic = np.array([m.hysteresis(x, x0, h, *further)[0] for m, h in zip(members, self.held, strict=True)])
        forces = np.array([m.restoring(x, v, h, *further)[0] for m, h in zip(members, hysteretic, strict=True)])
        if self.ensemble.level is not None:
            level = self.ensemble.level
            forces = level.centre(np.array(x), further) + level.spread(further) * forces
        return forces + beyond, hysteretic

    def accept(self, x, v, further):
        """Renew the memory at a sample; R there, and each member's."""
        last, fast = self.memory[0], abs(v) >= self.ensemble.band
        if last == 0 or (fast and last * v <= 0):
            self.memory[1] = _seen(self.ensemble, x, v, further)[0]
            self.held[:] = self.latest
        if fast:
            self.memory[0] = v
        forces, self.latest[:] = self.evaluate(x, v, further)
        _, v, further, _ = _seen(self.ensemble, x, v, further)
        sources = np.array([v if source < 0 else further[source] for source in self.ensemble.sources])
        self.late += np.array(self.ensemble.shares) * (sources - self.late)
        return float(np.mean(forces)), forces

    def between(self, x, v, further):
        """R with the memory as it stands."""
        return float(np.mean(self.evaluate(x, v, further)[0]))


def _seen(ensemble, x, v, further):
    """What the networks see of x, v and the further inputs, and the force of the tail."""
    force = 0.0
    if ensemble.ends is not None:
        signals, limits, tail = np.array([x, v, *further]), ensemble.ends.limits, ensemble.ends.tail
        near = np.clip(signals, limits[:, 0], limits[:, 1])
        force = tail.stiffness * (x - near[0]) + tail.damping * (v - near[1])
        x, v, further = near[0], near[1], near[2:]
    if ensemble.curves:
        bent = zip(further, ensemble.curves, strict=True)
        further = np.array([u if curve is None else float(curve(u)) for u, curve in bent])
    return x, v, further, force


class NumpyNormal:
    """As ``CompiledNormal``, with BLAS, chunk by chunk."""

    def __init__(self, sizes, inputs, target, precision="float64", prior=None):
        self._prior = np.zeros(parameter_count(sizes)) if prior is None else prior
        self.samples, self._sizes, self._kind = len(target), tuple(sizes), np.dtype(precision)
        self._inputs, self._target = inputs.astype(self._kind), target.astype(self._kind)
        self._length = 1024
        self._sums = np.zeros((0, 0))

    def _parts(self):
        return [slice(k, k + self._length) for k in range(0, self.samples, self._length)]

    def _forward(self, w, part):
        layers = unflatten(w.astype(self._kind), self._sizes)
        acts = [self._inputs[:, part]]
        for weights, bias in layers[:-1]:
            acts.append(np.tanh(weights @ acts[-1] + bias[:, None]))
        weights, bias = layers[-1]
        return acts, (weights @ acts[-1] + bias[:, None])[0] - self._target[part]

    def squares(self, w):
        errors = (self._forward(w, part)[1] for part in self._parts())
        return sum(float(np.sum(np.square(error), dtype=np.float64)) for error in errors) + float(self._prior @ (w * w))

    def build(self, w):
        count = parameter_count(self._sizes)
        self._sums = np.zeros((count + 1, count + 1))
        for part in self._parts():
            rows = self._rows(w, part)
            self._sums += rows @ rows.T
        self._sums[:-1, :-1] += np.diag(self._prior)
        self._sums[-1, :-1] += self._prior * w
        return float(self._sums[-1, -1] + self._prior @ (w * w))

    def _rows(self, w, part):
        """Rows d y/d w and, last, the residual, for one chunk."""
        layers = unflatten(w.astype(self._kind), self._sizes)
        acts, residual = self._forward(w, part)
        delta = np.ones((1, len(residual)), self._kind)
        rows = [residual[None]]
        for (weights, _), below in zip(reversed(layers), reversed(acts), strict=True):
            products = (delta[:, None] * below[None]).reshape(-1, len(residual))
            rows[:0] = [products, delta]
            delta = (weights.T @ delta) * (1 - below * below)
        return np.concatenate(rows)

    def diagonal(self):
        return np.diagonal(self._sums)[:-1].copy()

    def gradient(self):
        return self._sums[-1, :-1].copy()

    def solve(self, damping):
        matrix = self._sums[:-1, :-1] + np.diag(damping)
        try:
            return np.asarray(scipy.linalg.solve(matrix, self._sums[-1, :-1], assume_a="pos", check_finite=False))
        except (np.linalg.LinAlgError, scipy.linalg.LinAlgWarning):
            return None
