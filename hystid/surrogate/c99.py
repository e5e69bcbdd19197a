"""A network as plain C99: one header and one source, to be compiled into somebody else's program.

The step is the function that the FMU runs, to the same bits in double precision. Its state belongs to the caller; it
allocates nothing, has no global data that change, and takes the same operations whatever the numbers are.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import prod
from pathlib import Path
from typing import Literal

import numpy as np

from hystid.errors import NetworkError, UsageError
from hystid.networks import onnx_reading
from hystid.surrogate import block, reader
from hystid.surrogate.emit import Functions, value_function
from hystid.surrogate.identifiers import Names, identifier, readable
from hystid.surrogate.loops import number
from hystid.surrogate.network import PortLayout, Ports, interface_of
from hystid.surrogate.program import Elementwise, MatMul, Port, Program
from hystid.surrogate.restoring_force import interface_of_surrogate, is_surrogate

Real = Literal["double", "float"]

_LIBM = (
    "acos", "asin", "asinh", "atan", "ceil", "copysign", "cos", "cosh", "erf", "exp", "expm1", "fabs", "floor", "fmax",
    "fmin", "fmod", "log", "log1p", "nearbyint", "pow", "sin", "sinh", "sqrt", "tan", "trunc",
)  # fmt: skip
_KEYWORDS = (
    "asm", "auto", "bool", "break", "case", "catch", "char", "class", "const", "continue", "default", "delete", "do",
    "double", "else", "enum", "extern", "false", "float", "for", "goto", "if", "inline", "int", "long", "new",
    "operator", "private", "public", "register", "restrict", "return", "short", "signed", "sizeof", "static", "struct",
    "switch", "template", "this", "throw", "true", "try", "typedef", "typename", "union", "unsigned", "using",
    "virtual", "void", "volatile", "while",
)  # fmt: skip  # of C and, as the header serves it too, C++
_LITERAL = re.compile(
    r"(?<![\w.])(0x[0-9a-fA-F.]+p[+-]?\d+|(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?|\d+[eE][+-]?\d+)(?![\w.])"
)
_EXP_FLOAT = """\
/* exp(s) - 1 = 2^k (1 + p) - 1 with s = k ln 2 + r, |r| <= ln 2 / 2, p = exp(r) - 1; 0 <= s <= 87. The polynomial is
 * Taylor's of degree 7, whose error there is below half a unit in the last place of a float. */
static inline void nn_exp_parts(float s, float *scale, float *p)
{
    const float shifted = s * 1.44269504f + 12582912.0f; /* 1.5 * 2^23: the low bits now hold k */
    const float k = shifted - 12582912.0f;
    const float r = (s - k * 0.693359375f) + k * 2.12194440e-4f; /* ln 2 in two parts */
    uint32_t bits;
    memcpy(&bits, &shifted, sizeof bits);
    bits = (bits + 127u) << 23;
    memcpy(scale, &bits, sizeof bits);
    *p = r + r * r * (0.5f + r * (0.166666667f + r * (0.0416666667f + r * (0.00833333333f + r * (0.00138888889f +
         r * 0.000198412698f)))));
}
"""


def c_source(path: Path, *, name: str = "surrogate", real: Real = "double") -> dict[str, str]:
    """Header and source of a network's step by their file names, ``NAME.h`` and ``NAME.c``; C99.

    path: an ONNX file, identified or any other that ``network_code`` compiles. real: element type of everything;
    "double" gives the bits of the FMU, "float" is for processors without double precision.
    Raises UsageError for a name that C cannot have, NetworkError as ``network_code``.
    """
    if identifier(name) != name or name in _KEYWORDS:
        raise UsageError(f"-o {name}.c: the file's name becomes that of C functions; choose letters, digits and _")
    if real not in ("double", "float"):
        raise UsageError(f"--real {real}: choose double or float")
    path = Path(path)
    proto = onnx_reading.load(path)
    try:
        program = reader.program(proto, "step")
        given = {entry.key: entry.value for entry in proto.metadata_props}
        interface = (
            interface_of_surrogate(onnx_reading.read(path)[1]) if is_surrogate(given) else interface_of(program, given)
        )
        return _Text(program, interface, name, real).files()
    except NetworkError as error:
        text = str(error)
        raise NetworkError(text if text.startswith(str(path)) else f"{path}: {text}") from error


class _Text:
    """Both files of one network."""

    def __init__(self, program: Program, interface: Ports, name: str, real: Real) -> None:
        self.program, self.interface, self.name, self.real = program, interface, name, real
        layout = PortLayout.of(program, interface)
        self.inputs, self.states = layout.inputs, layout.states
        self.outputs, self.nexts = layout.outputs, layout.nexts
        self.functions: Functions = value_function(program, "network")
        taken = Names({"outside_training_range", "work", *_KEYWORDS})
        self.fields = {port.name: taken.unique(port.name) for port in (*program.inputs, *program.outputs)}

    def files(self) -> dict[str, str]:
        """Header and source."""
        body = "\n".join([self.functions.tables, self.functions.value])
        if self.real == "float":
            body = _in_single(body)
        source = "\n".join(
            [
                f'#include "{self.name}.h"\n\n#include <math.h>\n#include <stdint.h>\n#include <string.h>\n',
                body,
                self._step(),
            ]
        )
        return {f"{self.name}.h": self._header(body), f"{self.name}.c": source}

    def _header(self, body: str) -> str:
        n, guard = self.name, f"{self.name.upper()}_H"
        size = sum(port.view.size for port in self.states)
        memory = [f"    {self.real} {self.fields[port.name]}[{port.view.size}];" for port in self.states]
        if self.functions.work:
            memory.append(f"    {self.real} work[{self.functions.work}]; /* of one step; needs no value before it */")
        rate = (
            f"#define {n.upper()}_SAMPLE_RATE {number(self.interface.sample_rate)} /* Hz */\n"
            if self.interface.sample_rate
            else ""
        )
        code = re.sub(r"/\*.*?\*/", "", body, flags=re.S)
        used = [name for name in _LIBM if re.search(rf"\b{name}f?\(", code)]
        return f"""\
/* {readable(n)}: one step of a network with memory, compiled from ONNX by hystid. C99, {self.real} precision.
 *
 * The state is the caller's: one for each instance, {n}_start() before the first step, then {n}_step() per sample.
 * No allocation, no data that change besides the state. The operations of a step are fixed:
 * {self._cost()}.
 * Functions of <math.h> that are called: {", ".join(used) or "none"}. */
#ifndef {guard}
#define {guard}

#define {n.upper()}_STATES {size}
{rate}
typedef struct {{
{chr(10).join(memory) or "    char none; /* this network has no memory */"}
}} {n}_state;

typedef struct {{
{chr(10).join(self._field(port) for port in self.inputs)}
}} {n}_inputs;

typedef struct {{
{chr(10).join(self._field(port) for port in self.outputs)}
    int outside_training_range; /* 1 where an input lies outside the range of the training data */
}} {n}_outputs;

#ifdef __cplusplus
extern "C" {{
#endif

void {n}_start({n}_state *state);
void {n}_step({n}_state *state, const {n}_inputs *in, {n}_outputs *out);

#ifdef __cplusplus
}}
#endif

#endif
"""

    def _field(self, port: Port) -> str:
        unit, trained = self.interface.units.get(port.name, ""), self.interface.training_range.get(port.name)
        notes = [f"[{unit}]"] if unit else []
        notes += [f"trained from {trained[0]:.6g} to {trained[1]:.6g}"] if trained else []
        size = f"[{port.view.size}]" if port.view.size > 1 else ""
        return f"    {self.real} {self.fields[port.name]}{size};" + (
            f" /* {readable(', '.join(notes))} */" if notes else ""
        )

    def _cost(self) -> str:
        products, others, tanh = 0, 0, 0
        for statement in self.program.statements:
            if isinstance(statement, MatMul):
                products += prod(statement.out.shape) * statement.a.shape[1]
            elif isinstance(statement, Elementwise) and statement.function == "tanh":
                tanh += statement.out.size
            else:
                others += statement.out.size
        return f"{products} multiply-adds, {tanh} tanh, {others} others"

    def _step(self) -> str:
        n, real = self.name, self.real
        starts = [
            f"    state->{self.fields[port.name]}[{i}] = {self._number(value)};"
            for port in self.states
            for i, value in enumerate(self.interface.initial.get(port.name, ()))
            if value
        ]
        places = {port.name: self._place("in", port) for port in self.inputs}
        places |= {port.name: f"state->{self.fields[port.name]}" for port in self.states}
        results = {port.name: self._place("out", port) for port in self.outputs}
        results |= {port.name: f"next_{i}" for i, port in enumerate(self.nexts)}
        nexts = [f"    {real} next_{i}[{port.view.size}];" for i, port in enumerate(self.nexts)]
        moves = [
            f"    memcpy(state->{self.fields[port.name]}, next_{i}, sizeof next_{i});"
            for i, port in enumerate(self.states)
        ]
        run = block.call(self.program, "", places, results, work="state->work" if self.functions.work else "0")
        none = [] if self.states or self.functions.work else ["    (void)state;"]
        return "\n".join(
            [
                f"void {n}_start({n}_state *state)",
                "{",
                "    memset(state, 0, sizeof *state);",
                *starts,
                "}",
                "",
                f"void {n}_step({n}_state *state, const {n}_inputs *in, {n}_outputs *out)",
                "{",
                *nexts,
                *none,
                f"    {run}",
                *moves,
                f"    out->outside_training_range = {self._outside()};",
                "}",
                "",
            ]
        )

    def _place(self, base: str, port: Port) -> str:
        return ("" if port.view.size > 1 else "&") + f"{base}->{self.fields[port.name]}"

    def _number(self, value: float) -> str:
        return number(value) if self.real == "double" else _in_single(number(value))

    def _outside(self) -> str:
        tests = []
        for port in self.inputs:
            low, high = self.interface.training_range.get(port.name, (-np.inf, np.inf))
            elements: Sequence[str] = [f"in->{self.fields[port.name]}"]
            if port.view.size > 1:
                elements = [f"{elements[0]}[{i}]" for i in range(port.view.size)]
            tests += [block.range_test(element, low, high) for element in elements]
        found = " || ".join(test for test in tests if test) or "0"
        return found if self.real == "double" else _in_single(found)


def _in_single(text: str) -> str:
    """The same C text in single precision."""
    replaced: Mapping[str, str] = {name: name + "f" for name in _LIBM}
    double_parts = re.compile(r"/\* exp\(s\) - 1 = 2\^k.*?\n}\n", re.S)
    text = double_parts.sub(lambda _: "@EXP@", text)
    text = text.replace("> 20.0 ? 40.0", "> 10.0 ? 20.0").replace(
        "> 700.0 ? 700.0", "> 80.0 ? 80.0"
    )  # of float's range
    text = re.sub(r"\bdouble\b", "float", text)
    text = _LITERAL.sub(lambda match: match[1] + "f", text)
    text = re.sub(rf"\b({'|'.join(replaced)})\(", lambda match: replaced[match[1]] + "(", text)
    return text.replace("@EXP@", _EXP_FLOAT)
