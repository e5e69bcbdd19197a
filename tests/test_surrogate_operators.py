"""Every ONNX operator: values against an independent runtime, derivatives against differences, adjoint by duality."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import helper
from surrogate_harness import DOUBLE, Compiled, compile_all, make_model, outside

from hystid.surrogate.operators import OPERATORS

RNG = np.random.default_rng(20261121)
B, I = np.array, np.int64  # noqa: E741

# id -> (operator, shapes of computed operands, constant operands behind them, attributes)
Case = tuple[str, list[tuple[int, ...]], list[Any], dict[str, Any]]
W34, W43 = RNG.normal(size=(3, 4)), RNG.normal(size=(4, 3))
ROW = RNG.normal(size=4)

UNARY = [
    "Abs", "Asinh", "Atan", "Ceil", "Celu", "Cos", "Cosh", "Elu", "Erf", "Exp", "Floor", "Gelu", "HardSigmoid",
    "HardSwish", "Identity", "LeakyRelu", "LogSoftmax", "Mish", "Neg", "Reciprocal", "Relu", "Round", "Selu", "Sigmoid",
    "Sign", "Sin", "Sinh", "Softmax", "Softplus", "Softsign", "Tan", "Tanh", "ThresholdedRelu",
]  # fmt: skip
CASES: dict[str, Case] = {name: (name, [(3, 4)], [], {}) for name in UNARY}
CASES |= {
    name: (name, [(3, 4), (4,)], [], {}) for name in ("Add", "Sub", "Mul", "Div", "Max", "Min", "Sum", "Mean", "PRelu")
}
CASES |= {
    f"Reduce{kind}": (f"Reduce{kind}", [(2, 3, 4)], [], {"axes": [0, -1]})
    for kind in ("Mean", "Max", "Min", "SumSquare", "L1", "L2")
}
CASES |= {
    "Add column": ("Add", [(3, 1), (1, 4)], [], {}),
    "three of Max": ("Max", [(3, 4), (4,), (3, 1)], [], {}),
    "Gelu tanh": ("Gelu", [(5,)], [], {"approximate": "tanh"}),
    "Elu alpha": ("Elu", [(5,)], [], {"alpha": 0.3}),
    "Celu alpha": ("Celu", [(5,)], [], {"alpha": 0.3}),
    "Pow square": ("Pow", [(5,)], [B(2.0)], {}),
    "Pow of constant": ("Exp", [(5,)], [], {}),
    "Mod": ("Mod", [(5,), (5,)], [], {"fmod": 1}),
    "Clip": ("Clip", [(5,)], [B(-0.5), B(0.4)], {}),
    "Clip above": ("Clip", [(5,)], ["", B(0.4)], {}),
    "Gemm": ("Gemm", [(2, 3)], [W34, ROW], {"alpha": 0.5, "beta": 2.0}),
    "Gemm transposed": ("Gemm", [(3, 2)], [W43], {"transA": 1, "transB": 1}),
    "Gemm computed": ("Gemm", [(2, 3), (3, 4), (1, 4)], [], {}),
    "MatMul": ("MatMul", [(2, 3)], [W34], {}),
    "MatMul vector": ("MatMul", [(3,)], [W34], {}),
    "MatMul two vectors": ("MatMul", [(3,), (3,)], [], {}),
    "MatMul matrix vector": ("MatMul", [(2, 3), (3,)], [], {}),
    "MatMul batch": ("MatMul", [(2, 5, 2, 3), (5, 3, 4)], [], {}),
    "MatMul rows": ("MatMul", [(2, 5, 3)], [W34], {}),
    "Concat": ("Concat", [(2, 3), (2, 4)], [], {"axis": -1}),
    "Concat first": ("Concat", [(2, 3), (1, 3)], [], {"axis": 0}),
    "Slice": ("Slice", [(4, 6)], [B([1, -1], I), B([4, -99], I), B([0, 1], I), B([2, -2], I)], {}),
    "Split": ("Split", [(2, 6)], [B([2, 4], I)], {"axis": 1}),
    "Gather": ("Gather", [(4, 3)], [B([[2, -1], [0, 0]], I)], {"axis": 0}),
    "Gather one": ("Gather", [(4, 3)], [B(1, I)], {"axis": 1}),
    "GatherElements": ("GatherElements", [(3, 3)], [B([[0, 2, 1], [1, 1, 0]], I)], {"axis": 0}),
    "Reshape": ("Reshape", [(4, 6)], [B([0, -1, 2], I)], {}),
    "Flatten": ("Flatten", [(2, 3, 4)], [], {"axis": 2}),
    "Transpose": ("Transpose", [(2, 3, 4)], [], {"perm": [2, 0, 1]}),
    "Transpose all": ("Transpose", [(2, 3)], [], {}),
    "Squeeze": ("Squeeze", [(1, 3, 1)], [B([0], I)], {}),
    "Squeeze all": ("Squeeze", [(1, 3, 1)], [], {}),
    "Unsqueeze": ("Unsqueeze", [(3,)], [B([0, 2], I)], {}),
    "Expand": ("Expand", [(3, 1)], [B([2, 3, 4], I)], {}),
    "Tile": ("Tile", [(2, 3)], [B([2, 2], I)], {}),
    "Pad": ("Pad", [(2, 3)], [B([1, 0, 0, 2], I), B(0.7)], {}),
    "Pad edge": ("Pad", [(2, 3)], [B([1, 2, 0, 2], I)], {"mode": "edge"}),
    "ReduceSum": ("ReduceSum", [(2, 3, 4)], [B([1], I)], {"keepdims": 0}),
    "ReduceSum all": ("ReduceSum", [(2, 3)], [], {}),
    "ReduceMean all": ("ReduceMean", [(2, 3)], [], {"keepdims": 0}),
    "Softmax axis": ("Softmax", [(2, 3, 4)], [], {"axis": 1}),
    "LayerNormalization": ("LayerNormalization", [(2, 4)], [ROW, ROW[::-1].copy()], {"axis": -1}),
    "BatchNormalization": ("BatchNormalization", [(1, 4, 3)], [ROW, ROW[::-1].copy(), ROW / 2, ROW**2], {}),
    "Conv": ("Conv", [(1, 2, 8)], [RNG.normal(size=(4, 2, 3)), ROW], {"strides": [2], "pads": [1, 1]}),
    "Conv plane groups": ("Conv", [(1, 2, 5, 6)], [RNG.normal(size=(4, 1, 3, 2))], {"group": 2, "dilations": [1, 2]}),
    "Conv same": ("Conv", [(1, 2, 7)], [RNG.normal(size=(3, 2, 4))], {"strides": [2], "auto_pad": "SAME_UPPER"}),
    "Conv same below": ("Conv", [(1, 2, 7)], [RNG.normal(size=(3, 2, 4))], {"auto_pad": "SAME_LOWER"}),
    "InstanceNormalization": ("InstanceNormalization", [(1, 4, 3)], [ROW, ROW[::-1].copy()], {}),
    "Einsum": ("Einsum", [(2, 3), (4, 3)], [], {"equation": "bi, ki -> kb"}),
    "Einsum implicit": ("Einsum", [(2, 3, 4), (4,)], [], {"equation": "abc,c"}),
    "Einsum outer": ("Einsum", [(2, 3), (2, 4)], [], {"equation": "bi,bj->bij"}),
    "Slice to the end": ("Slice", [(4, 6)], [B([-3], I), B([2**63 - 1], I), B([1], I)], {}),
    "MaxPool": ("MaxPool", [(1, 2, 8)], [], {"kernel_shape": [2], "strides": [2]}),
    "AveragePool": ("AveragePool", [(1, 2, 8)], [], {"kernel_shape": [3]}),
    "GlobalAveragePool": ("GlobalAveragePool", [(1, 2, 8)], [], {}),
    "Cast": ("Cast", [(3,)], [], {"to": DOUBLE}),
    "Dropout": ("Dropout", [(3,)], [], {}),
}  # fmt: skip
SINGLE = ("Erf", "Gelu", "Gelu tanh")  # the other side has erf, or its constants, in single precision
POSITIVE = {"Log": (4,), "Sqrt": (4,)}
CASES |= {name: (name, [shape], [], {}) for name, shape in POSITIVE.items()}
CASES |= {name: (name, [(4,)], [], {}) for name in ("Acos", "Asin")}


def single(case: Case) -> Any:
    """A model of one node; computed operands are inputs, "" is an operand left out."""
    name, shapes, constants, attributes = case
    inputs = {f"in{i}": shape for i, shape in enumerate(shapes)}
    stored = {f"k{i}": value for i, value in enumerate(constants) if not isinstance(value, str)}
    operands = [*inputs, *(f"k{i}" if f"k{i}" in stored else "" for i in range(len(constants)))]
    outputs = ["y0", "y1"] if name == "Split" else ["y0"]
    old_axes = name.startswith("Reduce") and "axes" in attributes
    opset = 13 if old_axes else 20 if name in ("Gelu", "Mish") else 17
    node = helper.make_node(name, operands, outputs, name=f"the {name}", **attributes)
    return make_model([node], inputs, outputs, stored, opset=opset)


@pytest.fixture(scope="module")
def compiled() -> dict[str, Compiled]:
    return compile_all({label: single(case) for label, case in CASES.items()})


def values(label: str) -> list[np.ndarray]:
    name, shapes, _, _ = CASES[label]
    low, high = (0.1, 2.0) if name in POSITIVE else (-0.9, 0.9)
    rng = np.random.default_rng(len(label))
    return [
        rng.uniform(low, high, shape) * (1 if name in POSITIVE or name in ("Acos", "Asin", "Tan") else 2)
        for shape in shapes
    ]


@pytest.mark.parametrize("label", CASES)
def test_value_agrees_with_an_independent_runtime(compiled: dict[str, Compiled], label: str) -> None:
    given = values(label)
    expected = outside(single(CASES[label]), {f"in{i}": value for i, value in enumerate(given)})
    for got, want in zip(compiled[label].value(given), expected, strict=True):
        assert got.shape == want.shape
        loose = 1e-6 if label in SINGLE else 1e-13  # a few roundings, in another order
        np.testing.assert_allclose(got, want, rtol=loose, atol=0.1 * loose)


@pytest.mark.parametrize("label", CASES)
def test_directional_derivative_agrees_with_differences_and_adjoint(compiled: dict[str, Compiled], label: str) -> None:
    given, rng, net = values(label), np.random.default_rng(7), compiled[label]
    seeds = [rng.normal(size=value.shape) for value in given]
    slopes = net.forward(given, seeds)
    step = 1e-6
    above = net.value([value + step * seed for value, seed in zip(given, seeds, strict=True)])
    below = net.value([value - step * seed for value, seed in zip(given, seeds, strict=True)])
    for slope, high, low in zip(slopes, above, below, strict=True):
        difference = (high - low).reshape(-1) / (2 * step)
        np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-7)  # step^2 and rounding / step
    weights = [rng.normal(size=slope.shape) for slope in slopes]
    back = net.adjoint(given, weights)
    ahead = sum(float(w @ s) for w, s in zip(weights, slopes, strict=True))
    assert sum(float(b @ s.reshape(-1)) for b, s in zip(back, seeds, strict=True)) == pytest.approx(
        ahead, rel=1e-11, abs=1e-12
    )


LOGIC = ["Less", "LessOrEqual", "Greater", "GreaterOrEqual", "Equal"]


def test_relations_and_logic() -> None:
    """Relations, logic, Where, casts between kinds: all of ONNX's truth tables on values that include equality."""
    nodes = [helper.make_node(name, ["a", "b"], [name]) for name in LOGIC]
    nodes += [
        helper.make_node("And", ["Less", "Greater"], ["And"]),
        helper.make_node("Or", ["Less", "Equal"], ["Or"]),
        helper.make_node("Xor", ["LessOrEqual", "Equal"], ["Xor"]),
        helper.make_node("Not", ["Or"], ["Not"]),
        helper.make_node("Where", ["Not", "a", "b"], ["chosen"]),
        helper.make_node("Cast", ["Less"], ["number"], to=DOUBLE),
        helper.make_node("Cast", ["a"], ["whole"], to=7),
        helper.make_node("Cast", ["a"], ["truth"], to=9),
        helper.make_node("Cast", ["whole"], ["whole_again"], to=DOUBLE),
        helper.make_node("Cast", ["truth"], ["truth_number"], to=DOUBLE),
        helper.make_node("IsNaN", ["a"], ["nan"]),
        helper.make_node("Cast", ["nan"], ["nan_number"], to=DOUBLE),
        helper.make_node("CastLike", ["truth", "a"], ["like"]),
    ]
    for name in ("And", "Or", "Xor", "Not", *LOGIC):
        nodes.append(helper.make_node("Cast", [name], [f"{name}_number"], to=DOUBLE))
    outputs = [
        "chosen",
        "number",
        "whole_again",
        "truth_number",
        "nan_number",
        "like",
        *(f"{n}_number" for n in ("And", "Or", "Xor", "Not", *LOGIC)),
    ]
    proto = make_model(nodes, {"a": (6,), "b": (6,)}, outputs)
    a, b = np.array([-1.7, 0.0, 2.0, 2.0, 3.9, np.nan]), np.array([1.0, 0.0, 2.0, -2.0, 4.0, 1.0])
    a_cast = np.array([-1.7, 0.0, 2.0, 2.0, 3.9, 0.0])  # casting NaN to a whole number has no defined answer
    for first in (a_cast, np.where(np.isnan(a), 0.5, a)):
        for got, want in zip(
            compile_all({"logic": proto})["logic"].value([first, b]), outside(proto, {"a": first, "b": b}), strict=True
        ):
            np.testing.assert_array_equal(got, want)


def test_shapes_are_computed_while_compiling() -> None:
    """What exporters write around dynamic shapes folds away: Shape, Size, Range, ConstantOfShape, whole numbers."""
    nodes = [
        helper.make_node("Shape", ["x"], ["shape"]),
        helper.make_node("Gather", ["shape", "zero"], ["rows"]),
        helper.make_node("Unsqueeze", ["rows", "axes"], ["rows_list"]),
        helper.make_node("Concat", ["rows_list", "minus"], ["target"], axis=0),
        helper.make_node("Reshape", ["x", "target"], ["flat"]),
        helper.make_node("ConstantOfShape", ["shape"], ["ones"], value=helper.make_tensor("v", DOUBLE, [1], [1.0])),
        helper.make_node("ReduceSum", ["ones"], ["count"], keepdims=0),
        helper.make_node("Size", ["x"], ["size"]),
        helper.make_node("Div", ["size", "five"], ["fifth"]),
        helper.make_node("Mod", ["size", "five"], ["rest"]),
        helper.make_node("Range", ["zero", "fifth", "one"], ["range"]),
        helper.make_node("Cast", ["range"], ["range_number"], to=DOUBLE),
        helper.make_node("Cast", ["rest"], ["rest_number"], to=DOUBLE),
        helper.make_node("Constant", [], ["two"], value_float=2.0),
        helper.make_node("Cast", ["two"], ["two_wide"], to=DOUBLE),
        helper.make_node("Mul", ["flat", "two_wide"], ["twice"]),
        helper.make_node("Add", ["count", "range_number"], ["sums"]),
        helper.make_node("Add", ["sums", "rest_number"], ["more"]),
    ]
    constants = {
        "zero": np.array(0),
        "axes": np.array([0]),
        "minus": np.array([-1]),
        "five": np.array(5),
        "one": np.array(1),
    }
    proto = make_model(nodes, {"x": (3, 2, 2)}, ["twice", "more"], constants)
    x = np.arange(12.0).reshape(3, 2, 2)
    net = compile_all({"shapes": proto})["shapes"]
    for got, want in zip(net.value([x]), outside(proto, {"x": x}), strict=True):
        np.testing.assert_array_equal(got, want)
    assert len(net.program.statements) == 3  # one product and two copies to the outputs


@pytest.mark.parametrize("operator", ["LSTM", "GRU", "RNN"])
@pytest.mark.parametrize("direction", ["forward", "reverse", "bidirectional"])
def test_recurrent_layers(operator: str, direction: str) -> None:
    """Three time steps, with initial state and every output; ONNX Runtime computes these in single precision only."""
    gates, ways, hidden, length = (
        {"LSTM": 4, "GRU": 3, "RNN": 1}[operator],
        2 if direction == "bidirectional" else 1,
        3,
        3,
    )
    rng = np.random.default_rng(gates)
    draw = lambda *shape: rng.normal(0, 0.6, shape).astype(np.float32)  # noqa: E731
    constants = {
        "W": draw(ways, gates * hidden, 2),
        "Rw": draw(ways, gates * hidden, hidden),
        "b": draw(ways, 2 * gates * hidden),
    }
    operands, outputs = ["x", "W", "Rw", "b", "", "h0"], ["y", "h"]
    inputs = {"x": (length, 1, 2), "h0": (ways, 1, hidden)}
    if operator == "LSTM":
        operands, outputs, inputs = [*operands, "c0"], [*outputs, "c"], inputs | {"c0": (ways, 1, hidden)}
    extra = {"linear_before_reset": 1} if operator == "GRU" and direction == "reverse" else {}
    node = helper.make_node(operator, operands, outputs, hidden_size=hidden, direction=direction, **extra)
    proto = make_model([node], inputs, outputs, constants, kind=1)
    given = [draw(*shape) for shape in inputs.values()]
    net = compile_all({"r": proto})["r"]
    expected = outside(proto, dict(zip(inputs, given, strict=True)))
    for got, want in zip(net.value(given), expected, strict=True):
        assert got.shape == want.shape
        np.testing.assert_allclose(got, want, atol=2e-6)  # single precision on the other side
    wide = [value.astype(float) for value in given]
    seeds = [rng.normal(size=value.shape) for value in wide]
    slopes, step = net.forward(wide, seeds), 1e-6
    above, below = (net.value([v + s * step * d for v, d in zip(wide, seeds, strict=True)]) for s in (1, -1))
    for slope, high, low in zip(slopes, above, below, strict=True):
        np.testing.assert_allclose(slope, (high - low).reshape(-1) / (2 * step), atol=1e-8)
    back = net.adjoint(wide, slopes)
    assert sum(float(b @ s.reshape(-1)) for b, s in zip(back, seeds, strict=True)) == pytest.approx(
        sum(float(s @ s) for s in slopes)
    )


def test_machine_learning_domain() -> None:
    """The two operators by which scikit-learn pipelines scale and regress."""
    nodes = [
        helper.make_node("Scaler", ["x"], ["z"], domain="ai.onnx.ml", offset=[1.0, 2.0, 3.0], scale=[0.5, 0.25, 2.0]),
        helper.make_node("LinearRegressor", ["z"], ["y"], domain="ai.onnx.ml", targets=2, intercepts=[0.25, 4.0],
                         coefficients=[1.0, -2.0, 3.0, 0.5, 0.5, 0.5]),
    ]  # fmt: skip
    proto = make_model(nodes, {"x": (1, 3)}, ["y"], kind=1)
    x = np.array([[0.3, -1.0, 2.0]], dtype=np.float32)
    np.testing.assert_allclose(compile_all({"ml": proto})["ml"].value([x])[0], outside(proto, {"x": x})[0], rtol=1e-6)


def test_every_operator_is_tested() -> None:
    """A new operator needs a case in this file."""
    source = Path(__file__).read_text(encoding="utf-8")
    untested = [
        name for _, name in OPERATORS if f'"{name}"' not in source and name not in UNARY and f"{name} " not in source
    ]
    assert [name for name in untested if not name.startswith("Reduce")] == []


def test_the_guide_lists_every_operator() -> None:
    guide = (Path(__file__).parents[1] / "docs" / "surrogate.md").read_text(encoding="utf-8")
    listed = {name.strip("`.;,") for line in guide.splitlines() if line.startswith("> ") for name in line[2:].split()}
    assert listed - {"and", "of", "ai.onnx.ml"} == {name for _, name in OPERATORS}


def test_tanh_and_sigmoid_are_accurate() -> None:
    """Within 3 units in the last place for tanh and 4 for the logistic function, from subnormal to saturated."""
    from scipy.special import expit

    proto = make_model(
        [helper.make_node("Tanh", ["x"], ["t"]), helper.make_node("Sigmoid", ["x"], ["s"])], {"x": (40001,)}, ["t", "s"]
    )
    x = np.concatenate(
        [
            np.linspace(-25, 25, 20001),
            np.sign(np.linspace(-1, 1, 19996)) * np.logspace(-320, 2, 19996),
            [np.nan, np.inf, -np.inf, 0.0],
        ]
    )
    tanh, sigmoid = compile_all({"f": proto})["f"].value([x])
    with np.errstate(invalid="ignore"):
        for got, want, units in ((tanh, np.tanh(x), 3), (sigmoid, expit(x), 4)):
            # NumPy's own answers are within 1 unit
            ordinary = np.isfinite(x)
            assert (np.abs(got - want)[ordinary] <= units * np.spacing(np.abs(want[ordinary]))).all()
    assert np.isnan(tanh[-4]) and np.isnan(sigmoid[-4])
    assert list(tanh[-3:]) == [1.0, -1.0, 0.0] and list(sigmoid[-3::2]) == [1.0, 0.5]
