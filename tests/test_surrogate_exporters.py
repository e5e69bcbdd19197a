"""Networks as training frameworks export them, step by step as FMUs."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from surrogate_harness import compile_all

from hystid.compiled import CompiledModel
from hystid.networks import onnx_reading
from hystid.surrogate import network_code

torch = pytest.importorskip("torch", reason="exports by PyTorch need the extra 'train'")


def export(
    module: Any, example: tuple[Any, ...], path: Path, inputs: list[str], outputs: list[str], **opened: Any
) -> None:
    """The exporter that needs no further packages; it announces its successor with a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module, example, str(path), dynamo=False, input_names=inputs, output_names=outputs, **opened
        )  # fmt: skip


def test_feed_forward(tmp_path: Path) -> None:
    torch.manual_seed(1)
    layers = [torch.nn.Linear(3, 8), torch.nn.Tanh(), torch.nn.LayerNorm(8), torch.nn.Linear(8, 8), torch.nn.SiLU()]
    layers += [torch.nn.Linear(8, 8), torch.nn.GELU(), torch.nn.Linear(8, 4), torch.nn.ELU(), torch.nn.Linear(4, 2)]
    module = torch.nn.Sequential(*layers).double().eval()
    x = torch.linspace(-1, 1, 15, dtype=torch.float64).reshape(5, 3)
    export(module, (x,), tmp_path / "net.onnx", inputs=["x"], outputs=["y"], dynamic_axes={"x": {0: "batch"}})
    code = network_code(tmp_path / "net.onnx")
    columns = {f"x[{i + 1}]": x[:, i].numpy() for i in range(3)}
    got = CompiledModel(code).simulate(columns, 1e-3, outputs=["y[1]", "y[2]"], interpolation="hold")
    with torch.no_grad():
        want = module(x).numpy()
    # epsilon of the normalisation and constants of GELU are stored in single precision
    np.testing.assert_allclose(np.stack([got["y[1]"], got["y[2]"]], axis=1), want, atol=1e-6)


@pytest.mark.parametrize("kind", ["LSTM", "GRU"])
def test_recurrent_state_is_carried(tmp_path: Path, kind: str) -> None:
    """A cell exported for one step, stepped by the FMU's memory, against the framework on the whole sequence."""
    torch.manual_seed(2)
    cell, head = getattr(torch.nn, kind)(2, 4).double(), torch.nn.Linear(4, 1).double()

    class OneStep(torch.nn.Module):  # type: ignore[misc, name-defined]
        def __init__(self) -> None:
            super().__init__()
            self.cell, self.head = cell, head

        def forward(self, u: Any, *state: Any) -> Any:
            y, after = self.cell(u, state if kind == "LSTM" else state[0])
            return (self.head(y[-1]), *(after if kind == "LSTM" else (after,)))

    states = ["h", "c"] if kind == "LSTM" else ["h"]
    blank = tuple(torch.zeros(1, 1, 4, dtype=torch.float64) for _ in states)
    export(
        OneStep(), (torch.zeros(1, 1, 2, dtype=torch.float64), *blank), tmp_path / "cell.onnx",
        inputs=["u", *(f"{s}_in" for s in states)], outputs=["y", *(f"{s}_out" for s in states)],
    )  # fmt: skip
    code = network_code(tmp_path / "cell.onnx")
    assert code.has_memory and [v.name for v in code.variables if v.causality == "input"] == ["u[1]", "u[2]"]
    u = np.random.default_rng(0).normal(size=(40, 2))
    got = CompiledModel(code).simulate({"u[1]": u[:, 0], "u[2]": u[:, 1]}, 1e-3, outputs=["y"], interpolation="hold")
    with torch.no_grad():
        want = head(cell(torch.tensor(u)[:, None])[0])[:, 0, 0].numpy()
    np.testing.assert_allclose(got["y"], want, atol=1e-12)


class Attention(torch.nn.Module):  # type: ignore[misc, name-defined]
    """A transformer layer over five samples."""

    shape = (1, 5, 2)

    def __init__(self) -> None:
        super().__init__()
        self.before, self.after = torch.nn.Linear(2, 8), torch.nn.Linear(8, 1)
        self.layer = torch.nn.TransformerEncoderLayer(8, 2, 16, batch_first=True, dropout=0.0)

    def forward(self, x: Any) -> Any:
        return self.after(self.layer(self.before(x)).mean(1))


class Convolution(torch.nn.Module):  # type: ignore[misc, name-defined]
    """A small convolutional network over sixteen samples of two channels."""

    shape = (1, 2, 16)

    def __init__(self) -> None:
        super().__init__()
        first = [torch.nn.Conv1d(2, 4, 3, padding=2, dilation=2), torch.nn.BatchNorm1d(4), torch.nn.ReLU()]
        second = [torch.nn.AvgPool1d(2), torch.nn.Conv1d(4, 4, 3, padding="same"), torch.nn.PReLU()]
        last = [torch.nn.AdaptiveAvgPool1d(1), torch.nn.Flatten(), torch.nn.Linear(4, 2), torch.nn.Softmax(1)]
        self.layers = torch.nn.Sequential(*first, *second, *last)

    def forward(self, x: Any) -> Any:
        return self.layers(x)


class Arithmetic(torch.nn.Module):  # type: ignore[misc, name-defined]
    """What people write between layers."""

    shape = (1, 6)

    def forward(self, x: Any) -> Any:
        a, b = x.chunk(2, 1)
        y = torch.where(a > b, a.clamp(-0.5, 0.5), b**3)
        z = torch.stack([y, a], -1).sum(-1)
        w = torch.cat([z.abs().sqrt(), z.sign() * z.exp().log1p()], 1)
        return w / (1e-3 + w.norm(dim=1, keepdim=True)) + torch.einsum("bi,bj->bij", z, z).flatten(1).mean(
            1, keepdim=True
        )


class WholeSequence(torch.nn.Module):  # type: ignore[misc, name-defined]
    """A recurrent network that sees a window at once and starts from rest."""

    shape = (1, 5, 2)

    def __init__(self) -> None:
        super().__init__()
        self.cell, self.head = (
            torch.nn.GRU(2, 4, num_layers=2, batch_first=True, bidirectional=True),
            torch.nn.Linear(8, 1),
        )

    def forward(self, x: Any) -> Any:
        return self.head(self.cell(x)[0][:, -1])


def test_what_people_export(tmp_path: Path) -> None:
    models, inputs, expected = {}, {}, {}
    for kind in (Attention, Convolution, Arithmetic, WholeSequence):
        torch.manual_seed(3)
        module = kind().double().eval()
        x = torch.randn(*kind.shape, dtype=torch.float64)
        export(module, (x,), tmp_path / "m.onnx", ["x"], ["y"], dynamic_axes={"x": {0: "batch"}})
        name = kind.__name__
        models[name], inputs[name] = onnx_reading.load(tmp_path / "m.onnx"), x.numpy()
        with torch.no_grad():
            expected[name] = module(x).numpy()
    for name, net in compile_all(models).items():
        # normalisations store epsilon in single precision: 1e-8 relative of 1e-5
        np.testing.assert_allclose(net.value([inputs[name]])[0], expected[name], rtol=0, atol=1e-9, err_msg=name)
