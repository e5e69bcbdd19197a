"""A hybrid as one Modelica package: the law with its fitted values, the networks, and an oscillator of both."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from hystid.identification.hybrid.law import Law
from hystid.modelcode import Variable
from hystid.modelica_text import class_texts, modifiers
from hystid.networks import Lag, TwoNetworkModel
from hystid.networks.perceptron import Network
from hystid.networks.ports import Polyline
from hystid.recording import Array
from hystid.rig.terms import starts_of
from hystid.rotation import turned_unit

PACKAGE, OSCILLATOR = "Hybrid", "Hybrid.Oscillator"
_UNIT = re.compile(r'(?<=unit = ")[^"]+')
STARTS = ("x_start", "v_start")  # of the oscillator, whatever the law calls its own


def package_text(law: Law, values: Mapping[str, float], residual: TwoNetworkModel, share: float) -> str:
    """Text of the package ``Hybrid``.

    values: fitted parameters of the law. residual: networks of the force that the law leaves, with the spread of R;
    share: factor of their force.
    """
    lines = [f'package {PACKAGE} "{law.name.rpartition(".")[2]}, and networks for the force that it leaves"']
    if law.text:  # in a package of its own: a rig may be called Network, or Oscillator
        body = [f"  {line}" if line else "" for line in class_texts(law.text).splitlines()]
        lines += ["  package Law", *body, "  end Law;"]
    for j, member in enumerate(residual.members):
        lines += _function(f"hysteresis{j + 1}", member.hysteresis, "Hysteretic force [N] of (x, x0, force at x0, ...)")
        lines += _function(f"restoring{j + 1}", member.restoring, "Force [N] of (x, v, hysteretic force, ...)")
    ours = [*_network(residual, share), *_oscillator(law, values, residual)]
    turns = law.model.code.variable("F").unit == "N.m"  # units are checked where law and networks meet
    lines += [_UNIT.sub(lambda unit: turned_unit(unit[0]), line) for line in ours] if turns else ours
    return "\n".join([*lines, f"end {PACKAGE};"]) + "\n"


def _function(name: str, network: Network, title: str) -> list[str]:
    sizes = network.sizes
    lines = [f'  function {name} "{title}"', f"    input Real u[{sizes[0]}];", "    output Real y;", "  protected"]
    body, place, signal = [], 0, "u"
    for k, (inputs, neurons) in enumerate(pairwise(sizes), start=1):
        count = inputs * neurons
        weights, bias = network.flat[place : place + count], network.flat[place + count : place + count + neurons]
        place += count + neurons
        rows = ", ".join(_vector(row) for row in weights.reshape(neurons, inputs))
        lines += [f"    constant Real W{k}[{neurons},{inputs}] = {{{rows}}};"]
        lines += [f"    constant Real b{k}[{neurons}] = {_vector(bias)};"]
        row = f"sum(W{k}[i, j]*{signal}[j] for j in 1:{inputs}) + b{k}[i]"
        if k < len(sizes) - 1:
            lines.append(f"    Real h{k}[{neurons}];")
            body.append(f"    h{k} := {{tanh({row}) for i in 1:{neurons}}};")
            signal = f"h{k}"
        else:
            body.append(f"    y := {row.replace('[i', '[1')};")
    return [*lines, "  algorithm", *body, f"  end {name};"]


def _network(residual: TwoNetworkModel, share: float) -> list[str]:
    spread = residual.spread
    assert spread is not None
    ports = [port.name for port in residual.inputs]
    signals = ["x", "v", *ports]
    members = range(1, len(residual.members) + 1)
    lags = [f"late{k + 1}" for k in range(len(residual.lags))]
    further = "".join(f", {name}_in" for name in ports) + "".join(f", {name}" for name in lags)
    lines = [
        '  block Network "Force that the law leaves; its memory is renewed once per sample"',
        f'    parameter Real period(unit = "s") = {_number(1 / residual.sample_rate)} "Sample time of the recordings";',
        f'    parameter Real share(unit = "1") = {_number(share)} "Share of the force that unseen branches confirm";',
        '    parameter Real f_start(unit = "N") = 0 "Force of the networks before the start";',
        f'    parameter Real spread_floor(unit = "N") = {_number(spread.floor)} "What all networks miss alike";',
        f'    parameter Real spread_factor(unit = "1") = {_number(spread.factor)} "Of the deviation between networks";',
        '    input Real x(unit = "m") "Displacement";',
        '    input Real v(unit = "m/s") "Velocity";',
        *(f'    input Real {port.name}(unit = "{port.unit}");' for port in residual.inputs),
        '    output Real f(unit = "N") "Force of the networks, opposes motion as a spring does";',
        '    output Real spread(unit = "N") "Standard deviation of the error of R";',
        f'    Real force[{len(members)}](each unit = "N") "Force that each pair of networks has for the whole";',
        *(f'    Real {name}_in "Nearest value within the training range";' for name in signals),
        '    discrete Real v_last(start = 0, fixed = true) "Velocity at the latest sample";',
        '    discrete Real x0(start = 0, fixed = true) "Displacement where the motion turned";',
    ]
    for j in members:
        lines.append(f'    discrete Real held{j}(start = f_start, fixed = true) "Hysteretic force where it turned";')
        lines.append(f'    discrete Real latest{j}(start = f_start, fixed = true) "Hysteretic force, latest sample";')
    for name in lags:
        lines.append(f'    discrete Real {name}(start = 0, fixed = true) "First-order lag, as the networks see it";')
        lines.append(f"    discrete Real {name}_next(start = 0, fixed = true);")
    if lags:
        lines.append("    discrete Real begun(start = 0, fixed = true);")
    lines.append("  equation")
    for name in signals:
        low, high = residual.training_range[name]
        lines.append(f"    {name}_in = min(max({name}, {_number(low)}), {_number(high)});")
    lines.append("    when sample(0, period) then")
    lines += ["      begun = 1;"] if lags else []
    lines.append("      x0 = if noEvent(v*pre(v_last) <= 0) then x_in else pre(x0);")
    for name, lag in zip(lags, residual.lags, strict=True):
        lines += _late(name, lag, residual)
    for j in members:
        lines.append(f"      held{j} = if noEvent(v*pre(v_last) <= 0) then pre(latest{j}) else pre(held{j});")
        lines.append(f"      latest{j} = hysteresis{j}({{x_in, x0, held{j}{further}}});")
    lines += ["      v_last = v;", "    end when;"]
    for j in members:
        Rh = f"hysteresis{j}({{x_in, x0, held{j}{further}}})"
        lines.append(f"    force[{j}] = restoring{j}({{x_in, v_in, {Rh}{further}}});")
    mean = f"sum(force)/{len(members)}"
    power = f"sum((force[j] - {mean})^2 for j in 1:{len(members)})/{len(members)}"
    between = [_lines(f"{n}_in", c) for n, c in zip(ports, spread.between, strict=bool(spread.between)) if c]
    lines.append(f"    f = share*{mean};")
    lines.append(f"    spread = {'*'.join([f'sqrt(spread_floor^2 + spread_factor^2*{power})', *between])};")
    return [*lines, "  end Network;"]


def _lines(name: str, curve: Polyline) -> str:
    """A curve at an input within the range."""
    parts = zip(curve.at, curve.at[1:], curve.slopes, strict=False)
    terms = (f"({_number(s)})*(min(max({name}, {_number(a)}), {_number(b)}) - {_number(a)})" for a, b, s in parts)
    return f"({' + '.join([_number(curve.to[0]), *terms])})"


def _late(name: str, lag: Lag, residual: TwoNetworkModel) -> list[str]:
    source = f"{lag.source}_in"
    share = _number(lag.share(1 / residual.sample_rate))
    return [
        f"      {name} = if noEvent(pre(begun) > 0.5) then pre({name}_next) else {source};",
        f"      {name}_next = {name} + {share}*({source} - {name});",
    ]


def _oscillator(law: Law, values: Mapping[str, float], residual: TwoNetworkModel) -> list[str]:
    code, mass = law.model.code, law.reading.mass
    settings = {name: _number(value) for name, value in {**values, **({mass: law.mass} if mass else {})}.items()}
    for place, start in zip(starts_of(code), STARTS, strict=True):
        settings[place if place not in code.states else f"{place}.start"] = start
    ports = {port.name for port in residual.inputs}
    others = [v for v in code.variables if v.causality == "input" and v.name != "F"]
    kept = {v.name: v.name if v.name in ports else _start(v) for v in others}
    inertia = f"law.{mass}" if mass else _number(law.mass)
    return [
        '  model Oscillator "One mass on the law and the networks: m a + R = F, R = R_physics + R_network"',
        '    parameter Real x_start(unit = "m") = 0 "Displacement at the start";',
        '    parameter Real v_start(unit = "m/s") = 0 "Velocity at the start";',
        '    input Real F(unit = "N") "Excitation, in the direction of x";',
        *(f'    input Real {port.name}(unit = "{port.unit}");' for port in residual.inputs),
        '    output Real x(unit = "m") "Displacement";',
        '    output Real v(unit = "m/s") "Velocity";',
        '    output Real a(unit = "m/s2") "Acceleration";',
        '    output Real R(unit = "N") "Restoring force";',
        '    output Real R_physics(unit = "N") "Share of the law";',
        '    output Real R_network(unit = "N") "Share of the networks";',
        '    output Real R_spread(unit = "N") "Standard deviation of the error of R";',
        f"    {'Law.' if law.text else ''}{law.name} law({', '.join(modifiers(settings))});",
        "    Network network;",
        "  equation",
        "    law.F = F - R_network;",
        *(f"    law.{name} = {value};" for name, value in kept.items()),
        "    x = law.x;",
        "    v = law.v;",
        "    a = der(law.v);",
        "    network.x = law.x;",
        "    network.v = law.v;",
        *(f"    network.{port.name} = {port.name};" for port in residual.inputs),
        "    R_physics = law.R;" if law.reading.force else f"    {inertia}*a + R_physics = law.F;",
        "    R_network = network.f;",
        "    R_spread = network.spread;",
        "    R = R_physics + R_network;",
        "  end Oscillator;",
    ]


def _vector(values: Array | Sequence[float]) -> str:
    return "{" + ", ".join(_number(value) for value in np.asarray(values)) + "}"


def _number(value: float) -> str:
    return repr(float(value))


def _start(variable: Variable) -> str:
    """Start of an input that nobody records, as Modelica writes it."""
    value = variable.start or 0.0
    return {"Boolean": str(bool(value)).lower(), "Integer": str(int(value))}.get(variable.type, _number(value))
