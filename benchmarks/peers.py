"""Peers of the two-network method on the same split: a Bouc-Wen fit by scipy, an LSTM in torch, a NARX of sysidentpy.

    python benchmarks/peers.py [DATA] [--starts N] [--epochs N]

MR damper of Dyke, random motion and voltage, every 4th sample: the first half is trained on, the second is unseen.
Every model gets displacement, velocity and voltage, and answers with the force by itself; none sees the measured force
of the unseen half. Prints one table: force NRMSE on both halves and processor time. A peer that is not installed is
named.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from hystid.comparison import nrmse
from hystid.identification import identify
from hystid.recording import Recording, read

DATA = Path(__file__).parents[1].parent / "shared" / "data"
FILE = Path("mr_damper_dyke") / "mr_damper_dyke_ranran50.csv"
EVERY = 4
Array = NDArray[np.float64]


def halves(folder: Path) -> tuple[Recording, Recording]:
    """First and second half of the recording."""
    whole = read(folder / FILE)

    def part(name: str, rows: slice) -> Recording:
        columns = {c: getattr(whole, c)[rows] for c in "Fxv"}
        extra = {"u_mr": whole.extra["u_mr"][rows]}
        return Recording(name, whole.t[rows] - whole.t[rows][0], **columns, extra=extra, units=whole.units)

    middle = len(whole) // 2
    return part("first half", slice(0, middle, EVERY)), part("second half", slice(middle, None, EVERY))


def inputs_of(recording: Recording) -> Array:
    """x, v, voltage as columns, shape (n, 3)."""
    return np.stack([recording.channel("x"), recording.channel("v"), recording.extra["u_mr"]], axis=1)


def bouc_wen(train: Recording, other: Recording) -> tuple[Array, Array]:
    """R = c(w) v + k x + alpha(w) z + offset, dz/dt = v (A - |z|^n (gamma sign(v z) + beta)), both linear in w, which
    follows the voltage late (Spencer and others, 1997, without the dashpot in series)."""
    scales = np.array([np.std(train.channel(name)) for name in ("x", "v", "F")])

    def force(p: Array, recording: Recording) -> Array:
        x, v, u = inputs_of(recording).T
        x, v, dt = x / scales[0], v / scales[1], recording.dt * scales[1] / scales[0]
        c0, c1, k, a0, a1, offset = p[:6]
        A, beta, gamma, n, late = np.exp(p[6:])
        share = -np.expm1(-recording.dt / late)
        z, w, out = 0.0, u[0], np.empty(len(x))
        for i in range(len(x)):
            out[i] = (c0 + c1 * w) * v[i] + k * x[i] + (a0 + a1 * w) * z + offset
            power = min(abs(z), 1e3) ** n
            z = min(max(z + dt * v[i] * (A - power * (gamma * np.sign(v[i] * z) + beta)), -1e3), 1e3)
            w += share * (u[i] - w)
        return out * scales[2]

    begin = np.array([0.2, 0.2, 0.0, 0.2, 0.2, 0.0, *np.log([5.0, 2.0, 2.0, 1.5, 0.01])])
    target, size = train.channel("F"), scales[2]
    found = least_squares(lambda p: (force(p, train) - target) / size, begin, x_scale=1.0, max_nfev=200)
    return force(found.x, train), force(found.x, other)


def lstm(train: Recording, other: Recording, epochs: int) -> tuple[Array, Array]:
    """One layer of 32 cells and a linear output; windows of 200 samples, Adam; the last fifth of the training half
    chooses the epoch."""
    import torch

    torch.manual_seed(0)
    raw = inputs_of(train)
    mean, scale = raw.mean(axis=0), raw.std(axis=0)
    level, size = train.channel("F").mean(), train.channel("F").std()

    class Net(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.cells, self.out = torch.nn.LSTM(3, 32, batch_first=True), torch.nn.Linear(32, 1)

        def forward(self, u: torch.Tensor) -> torch.Tensor:
            return self.out(self.cells(u)[0])[..., 0]

    def tensor(recording: Recording) -> torch.Tensor:
        return torch.tensor((inputs_of(recording) - mean) / scale, dtype=torch.float32)

    net, u = Net(), tensor(train)
    y = torch.tensor((train.channel("F") - level) / size, dtype=torch.float32)
    cut, length = len(u) * 4 // 5, 200
    begins = range(0, cut - length, length // 2)
    windows = torch.stack([u[k : k + length] for k in begins])
    targets = torch.stack([y[k : k + length] for k in begins])
    optimiser, best, kept = torch.optim.Adam(net.parameters(), lr=5e-3), np.inf, net.state_dict()
    for _ in range(epochs):
        for batch in torch.randperm(len(windows)).split(16):
            optimiser.zero_grad()
            answer = net(windows[batch])
            torch.mean((answer - targets[batch])[:, 30:] ** 2).backward()  # 30 samples to settle from rest
            optimiser.step()
        with torch.no_grad():
            error = float(torch.mean((net(u[None])[0] - y)[cut:] ** 2))
        if error < best:
            best, kept = error, {name: value.clone() for name, value in net.state_dict().items()}
    net.load_state_dict(kept)
    with torch.no_grad():
        first, second = (net(tensor(r)[None])[0].numpy() * size + level for r in (train, other))
    return first, second


def narx(train: Recording, other: Recording) -> tuple[Array, Array]:
    """Polynomials of degree 2 in two past forces and inputs, chosen by forward regression; run on its own forces."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS

    scale, size = inputs_of(train).std(axis=0), train.channel("F").std()
    model = FROLS(n_terms=20, ylag=2, xlag=[[1, 2]] * 3, basis_function=Polynomial(degree=2))
    u, y = inputs_of(train) / scale, train.channel("F")[:, None] / size
    model.fit(X=u, y=y)
    runs = [(u, y), (inputs_of(other) / scale, other.channel("F")[:, None] / size)]
    first, second = (model.predict(X=inputs, y=force[:2])[:, 0] * size for inputs, force in runs)
    return first, second


def ours(train: Recording, other: Recording, starts: int) -> tuple[Array, Array]:
    """The two-network method with the voltage as a further input."""
    found = identify([train], mass=0.0, layers=(8, 8), ensemble=starts, inputs=["u_mr"], holdout=[other])
    first, second = (item.network.R for item in found.comparisons)
    return first, second


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", nargs="?", type=Path, default=DATA)
    parser.add_argument("--starts", type=int, default=10, help="trainings of the two-network method")
    parser.add_argument("--epochs", type=int, default=300, help="of the LSTM")
    given = parser.parse_args()
    train, other = halves(given.data)
    models: dict[str, Callable[[], tuple[Array, Array]]] = {
        "Bouc-Wen, least squares (scipy)": lambda: bouc_wen(train, other),
        "LSTM, 32 cells (torch)": lambda: lstm(train, other, given.epochs),
        "NARX, degree 2 (sysidentpy)": lambda: narx(train, other),
        "hystid, two networks": lambda: ours(train, other, given.starts),
    }
    print("| model | trained half | unseen half | processor time [s] |\n|---|---|---|---|")
    for name, run in models.items():
        begin = time.process_time()
        try:
            answers = run()
        except ImportError as missing:
            print(f"| {name} | not installed: {missing.name} | | |", flush=True)
            continue
        errors = [nrmse(R, r.channel("F")) for R, r in zip(answers, (train, other), strict=True)]
        print(f"| {name} | {errors[0]:.3f} | {errors[1]:.3f} | {time.process_time() - begin:.0f} |", flush=True)


if __name__ == "__main__":
    main()
