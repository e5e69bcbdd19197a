"""Functions are inlined: their statements run on expressions, where an ``if`` merges the values of its branches."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial

import numpy as np

from hystid.modelica.expr import ONE, ZERO, Expr, Num, Op, Ref, nodes, op, rebuild
from hystid.modelica.flat import Function, FunctionVariable, Statement
from hystid.modelica.values import (
    UNSET,
    Interpreter,
    Record,
    Value,
    array,
    filled_in,
    flattened,
    is_unset,
    mapped,
    merge,
)
from hystid.modelica.workarounds.function_bodies import ELSE, NOTHING, STOP, WHILE

_WHILE_LIMIT = 10_000
_ROUNDS = 100  # of a while-loop whose condition depends on variables
NO_NUMBER = Op("sqrt", (Num(-1.0),))  # ends the run
_STATEMENT_COST = 3  # in operations on scalars


class Call:
    """One call of a function: its variables hold values (expressions), its statements are run."""

    def __init__(self, expander: Interpreter, function: Function, args: list[Value]) -> None:
        self.expander = expander
        self.function = function
        self.values: dict[str, Value] = {}
        self._undecided: list[Expr] = []  # conditions of the branches around the statement that runs
        for variable, value in itertools.zip_longest(function.inputs, args):
            if variable is None:
                expander.refuse(f"function '{function.name}' is given too many arguments")
            self.values[variable.name] = value if value is not None else self._default(variable)

    def run(self) -> list[Value]:
        """Values of the outputs."""
        for variable in (*self.function.outputs, *self.function.locals):
            for part in variable.fields or (variable,):
                self.values[part.name] = self._initial(part)
            if variable.fields and variable.default is not None:
                self._set(Ref(variable.name), self.expander.value(variable.default, self.values))
        self._statements(self.function.body)
        results = [self._result(v) for v in self.function.outputs]
        if any(is_unset(e) for r in results for e in flattened(r)):
            self.expander.refuse(f"function '{self.function.name}' leaves an output without a value on some path")
        return results

    def _result(self, variable: FunctionVariable) -> Value:
        if not variable.fields:
            return self.values[variable.name]
        names = [f.name.removeprefix(variable.name + ".") for f in variable.fields]
        return Record.of(names, (self.values[f.name] for f in variable.fields))

    def section(self, start: Mapping[str, Value]) -> dict[str, Value]:
        """Values after the statements of an algorithm section; start: those before it, of what it assigns."""
        self.values = dict(start)
        self._statements(self.function.body)
        return {name: self.values[name] for name in start}

    def _default(self, variable: FunctionVariable) -> Value:
        if variable.default is None:
            self.expander.refuse(f"function '{self.function.name}' is called without '{variable.name}'")
        return self.expander.value(variable.default, self.values)

    def _initial(self, variable: FunctionVariable) -> Value:
        if variable.name.startswith(NOTHING):
            return UNSET
        if variable.default is not None:
            return self.expander.value(variable.default, self.values)
        if not variable.dims:
            return UNSET
        shape = tuple(int(self.expander.number(d, self.values, "a size")) for d in variable.dims)
        return array([UNSET] * int(np.prod(shape))).reshape(shape)

    def _statements(self, statements: tuple[Statement, ...]) -> None:
        for statement in statements:
            _RUN[statement.kind](self, statement)

    def _assign(self, s: Statement) -> None:
        assert s.value is not None
        self.expander.spend(_STATEMENT_COST)
        if s.value == Ref(STOP):
            self._stop()
        if len(s.targets) == 1:
            self._set(s.targets[0], self.expander.value(s.value, self.values))
            return
        assert isinstance(s.value, Op)
        for target, part in zip(s.targets, self.expander.outputs(s.value, self.values), strict=False):
            self._set(target, part)

    def _set(self, target: Expr | None, value: Value) -> None:
        if isinstance(target, Ref) and isinstance(value, Record):
            self.values.update((f"{target.name}.{field}", value.field(field)) for field in value.names)
        elif isinstance(target, Ref):
            self.values[target.name] = value
        elif isinstance(target, Op) and target.name == "[]" and isinstance(target.args[0], Ref):
            name = target.args[0].name
            base = self.values[name]
            assert isinstance(base, np.ndarray)
            changed = base.copy()
            pairs = zip(target.args[1:], base.shape, strict=True)
            varying = self.expander.varying(target.args[1], self.values) if len(target.args) == 2 else None
            if varying is not None and not isinstance(value, np.ndarray | tuple):
                self.values[name] = self.expander.replaced(base, varying, value)
                return
            index = [self.expander.index(s, n, self.values) for s, n in pairs]
            changed[tuple(slice(None) if i is None else i for i in index)] = value
            self.values[name] = changed

    def _stop(self) -> None:
        """An error statement is reached, or may be: then the parameters that decide it are asked for."""
        for condition in self._undecided:
            self.expander.number(condition, {}, f"whether function '{self.function.name}' stops with its error")
        self.expander.refuse(f"function '{self.function.name}' stops with its error for these values")

    def _choose(self, branches: tuple[tuple[Expr, tuple[Statement, ...]], ...]) -> None:
        if not branches:
            return
        condition = self.expander.scalar(branches[0][0], self.values)
        if isinstance(condition, Num):
            if condition.value:
                self._statements(branches[0][1])
            else:
                self._choose(branches[1:])
            return
        before = dict(self.values)
        self._undecided.append(condition)
        self.values = {k: _where(v, condition, ONE) for k, v in before.items()}
        self._statements(branches[0][1])
        self._undecided[-1] = op("not", condition)
        taken, self.values = self.values, {k: _where(v, condition, ZERO) for k, v in before.items()}
        self._choose(branches[1:])
        self._undecided.pop()
        last = isinstance(branches[0][0], Ref) and branches[0][0].name.startswith(ELSE)
        join = filled_in if last else merge
        self.values = {k: join(condition, taken.get(k, v), v) for k, v in self.values.items()}

    def _loop(self, s: Statement) -> None:
        assert s.value is not None
        if s.name.startswith(WHILE):
            outside, self.expander.place = self.expander.place, s.place
            self._while(s.branches[0][1])
            self.expander.place = outside
            return
        outer = self.values.get(s.name)
        for v in flattened(self.expander.value(s.value, self.values)):
            self.values[s.name] = v
            self._statements(s.branches[0][1])
        if outer is None:
            self.values.pop(s.name, None)
        else:
            self.values[s.name] = outer

    def _while(self, body: tuple[Statement, ...]) -> None:
        """The first statement tests the condition."""
        test = body[0].targets[0]
        assert isinstance(test, Ref)
        for _ in range(_WHILE_LIMIT):
            self._assign(body[0])
            condition = self.expander.scalar(test, self.values)
            if not isinstance(condition, Num):
                self.expander.ask_for(condition)
                self._unrolled(condition, body, test)
                return
            if not condition.value:
                return
            self._statements(body[1:])
        self.expander.refuse(f"a while-loop takes more than {_WHILE_LIMIT} steps, which cannot be written out")

    def _unrolled(self, condition: Expr, body: tuple[Statement, ...], test: Ref) -> None:
        """Rounds while a condition on variables holds; where it still does after the last, no number is the answer.

        Each round takes what the one before it leaves where it runs: what is a number there, as a counter, stays one.
        """
        rounds: list[tuple[Expr, dict[str, Value]]] = []
        for _ in range(self._rounds(body, test)):
            rounds.append((condition, self.values))
            self.values = {k: _where(v, condition, ONE) for k, v in self.values.items()}
            self._undecided.append(condition)
            self._statements(body[1:])
            self._assign(body[0])
            condition = self.expander.scalar(test, self.values)
            if condition == ZERO:
                break
        else:
            for name in {n for n in assigned(body) if n in self.values and n != test.name}:
                self.values[name] = mapped(partial(_endless, condition), self.values[name])
        for taken, before in reversed(rounds):
            self._undecided.pop()
            self.values = {k: merge(taken, self.values.get(k, v), v) for k, v in before.items()}

    def _rounds(self, body: tuple[Statement, ...], test: Ref) -> int:
        """How many rounds are written out: those to the end of what is counted, if one is in sight."""
        counted = {
            s.targets[0]
            for s in body
            if s.kind == "assign" and isinstance(s.targets[0], Ref) and s.value == Op("+", (s.targets[0], ONE))
        }
        bounds = []
        for node in nodes(body[0].value or ZERO):
            if isinstance(node, Op) and node.name in ("<", "<=") and node.args[0] in counted:
                bound = self.expander.scalar(node.args[1], self.values)
                bounds += [int(bound.value) + 2] if isinstance(bound, Num) and bound.value > 0 else []
        return min([_ROUNDS, *bounds])

    def when(self, s: Statement) -> None:
        """A when-clause, of an algorithm section."""
        self.expander.refuse("a when-clause stands in models only")

    def check(self, s: Statement) -> None:
        """An assertion; those of functions are not looked at."""

    def renew(self, s: Statement) -> None:
        """A reinit, of an algorithm section."""
        self.expander.refuse("reinit() stands in when-clauses only")


_RUN: dict[str, Callable[[Call, Statement], None]] = {
    "assign": Call._assign,
    "if": lambda call, s: call._choose(s.branches),
    "for": Call._loop,
    "when": lambda call, s: call.when(s),
    "assert": lambda call, s: call.check(s),
    "reinit": lambda call, s: call.renew(s),
}


def _endless(goes_on: Expr, value: Expr) -> Expr:
    """A value after the last round, where a loop would go on."""
    return value if is_unset(value) else op("if", goes_on, NO_NUMBER, value)


def _where(value: Value, condition: Expr, holds: Num) -> Value:
    """A value that some path has not set, where a condition is known to hold or not."""
    if not any(is_unset(e) for e in flattened(value)):
        return value
    known: dict[Expr, Expr] = {condition: holds}
    if isinstance(condition, Op) and condition.name == "not":
        known[condition.args[0]] = ONE if holds == ZERO else ZERO
    return mapped(lambda e: rebuild(e, known.get), value)


def assigned(statements: Iterable[Statement]) -> Iterator[str]:
    """Names of the variables that statements assign."""
    for s in statements:
        for target in s.targets:
            base = target.args[0] if isinstance(target, Op) else target
            if isinstance(base, Ref):
                yield base.name
        yield from (name for _, body in s.branches for name in assigned(body))
