"""The value functions of ``hy_model.h`` as readable C: Modelica names stand in comments beside the slots."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from hystid.modelica.blocks import Assign, Solve, Step, components, sources, targets
from hystid.modelica.c_expr import HELPERS, Printer, comment, number, quoted
from hystid.modelica.delays import TEXTS, DelayPrinter
from hystid.modelica.event_model import BEGIN, HOMOTOPY, INITIAL, Relation, pre
from hystid.modelica.expr import RELATIONS, Expr, Num, Op, Ref, Text, op, rebuild, refs
from hystid.modelica.flat import Assertion
from hystid.modelica.hybrid import HybridModel
from hystid.modelica.layout import LIMIT, MANY, Layout, tick, warned
from hystid.modelica.scalar import ScalarEquation
from hystid.modelica.shown import Shown
from hystid.modelica.solvers import HOMOTOPY_WAY, NEAREST, NEWTON, OPERATING_POINT, SEARCH, SILENT, SOLVERS, TURNS

# Arguments of show, and how its text reads them.
_ROWS = {"v": "v[", "in": " in[", "out": " out["}
# How often initialisation looks at the relations anew: a start that still changes then has no consistent modes.
_START_PASSES = 50
# Relations of which all values are tried where they do not settle: 2^10 evaluations at an instant take milliseconds.
_MOST_TRIED = 10
# Sweeps of one instant in which all relations are renewed together, before they take turns.
_TOGETHER = 3


def feedback(model: HybridModel) -> list[Relation]:
    """Relations that depend on their own value at one instant; none where there are too many to try all values."""
    graph: dict[str, frozenset[str]] = {}
    for step in model.event:
        graph |= dict.fromkeys(targets(step), sources(step))
    graph |= {r.name: refs(r.value) for r in model.relations}
    looped = {n for members in components(graph) if len(members) > 1 for n in members}
    found = [r for r in model.relations if r.name in looped and isinstance(r.value, Op) and r.value.name in RELATIONS]
    return found if len(found) <= _MOST_TRIED else []


class Emitter:
    """Prints one model."""

    def __init__(self, model: HybridModel, layout: Layout) -> None:
        self.model = model
        self.layout = layout
        self.printer = Printer(self.slot)
        self.needs_solve = False
        self.needs_nearest = False
        self.needs_newton = False
        self.needs_turns = False
        self.needs_search = False
        self.delays = [DelayPrinter(d, n, model.flat.experiment.step, self.printer) for d, n in model.delays.items()]
        self._blocks: dict[Solve, int] = {}
        self._block_text: list[str] = []

    def slot(self, name: str) -> str:
        """``v[3 /* name */]``."""
        return f"v[{self.layout.slots[name]} /* {comment(name)} */]"

    # -- steps

    def steps(self, steps: Iterable[Step]) -> list[str]:
        """Statements, one step after another."""
        return [line for step in steps for line in self._step(step)]

    def _step(self, step: Step) -> list[str]:
        if isinstance(step, Assign):
            declarations, texts = self.printer.lines([step.value])
            line = f"{self.slot(step.variable)} = {texts[0]};"
            return [*declarations, line] if declarations else [line]
        self.needs_solve = True
        self.needs_nearest |= step.linear
        return self._linear(step) if step.linear else self._nonlinear(step)

    def _linear(self, step: Solve) -> list[str]:
        n = len(step.variables)
        entries = [e for row in step.jacobian for e in row]
        declarations, texts = self.printer.lines([*entries, *step.residuals])
        lines = [f"{{ /* {self._what(step)} */"]
        lines += [f"    const double last[{n}] = {{{', '.join(self.slot(name) for name in step.variables)}}};"]
        lines += [f"    {self.slot(name)} = 0;" for name in step.variables]
        lines += ["    for (int alone = 1;; alone = 0) {", *(f"        {d}" for d in declarations)]
        lines += [f"        double A[{n * n}] = {{{', '.join(texts[: n * n])}}};"]
        lines += [f"        double b[{n}] = {{{', '.join(texts[n * n :])}}}, work[{2 * n}];"]
        lines += [f"        int order[{n}];"]
        nearest = f"hy_nearest(m, &{self.slot(MANY)}, {quoted(self._what(step))}, {n}, A, b, last, work, order)"
        lines += [f"        if (alone ? hy_solve({n}, A, b) : {nearest}) {{"]
        lines += ["            if (alone) continue;"]
        lines += [f"            return hy_singular(m, {quoted(self._what(step))});", "        }"]
        lines += [f"        {self.slot(name)} = -b[{i}];" for i, name in enumerate(step.variables)]
        return [*lines, "        break;", "    }", "}"]

    def _nonlinear(self, step: Solve) -> list[str]:
        self.needs_newton = True
        k, n = self._block(step), len(step.variables)
        slots = ", ".join(f"{self.layout.slots[name]} /* {comment(name)} */" for name in step.variables)
        nominal = ", ".join(number(self._nominal(name)) for name in step.variables)
        guessed = {a.variable: self.printer.value(a.value) for a in self.model.start.guesses}
        start = ", ".join(guessed.get(n) or number(self.model.start.starts.get(n, 0.0)) for n in step.variables)
        call = f"hy_newton(v, {n}, slots, nominal, hy_residual{k}, hy_jacobian{k}, r, A, x, whole)"
        return [
            f"{{ /* {self._what(step)} */",
            f"    static const int slots[{n}] = {{{slots}}};",
            f"    static const double nominal[{n}] = {{{nominal}}};",
            f"    {'' if guessed.keys() & set(step.variables) else 'static '}const double start[{n}] = {{{start}}};",
            f"    double r[{n}], A[{n * n}], x[{3 * n}], last[{n}];",
            "    int failed = 1;",
            f"    for (int i = 0; i < {n}; i++) last[i] = v[slots[i]];",
            "    for (int attempt = 0; failed && attempt < 4; attempt++) {",
            "        const int whole = attempt % 2;",
            f"        for (int i = 0; attempt && i < {n}; i++) v[slots[i]] = attempt == 1 ? last[i] : start[i];",
            f"        failed = {call};",
            "    }",
            f"    for (int i = 0; failed && i < {n}; i++) v[slots[i]] = start[i];",
            f"    if (failed && {self.slot(INITIAL)} != 0) {{",
            f"        double work[{n * (n + 5)}];",
            f"        failed = hy_operating_point(v, {n}, slots, nominal, hy_residual{k}, hy_jacobian{k}, work, "
            f"&{self.slot(LIMIT)});",
            "    }",
            f"    if (failed) return hy_not_converged(m, {quoted(self._what(step))});",
            "}",
        ]

    def _nominal(self, name: str) -> float:
        v = self.model.variables.get(name.removeprefix("der(").removesuffix(")"))
        return abs(v.nominal) if v is not None and v.nominal else 1e-3

    def _what(self, step: Solve) -> str:
        names = ", ".join(step.variables[:4]) + (", ..." if len(step.variables) > 4 else "")
        return comment(f"simultaneous equations for {names}, {step.place.short}")

    def _block(self, step: Solve) -> int:
        """Number of a nonlinear block, its functions printed once."""
        if step not in self._blocks:
            k = self._blocks[step] = len(self._blocks) + 1
            entries = [e for row in step.jacobian for e in row]
            for name, values, exp in (("residual", step.residuals, "hy_limited"), ("jacobian", entries, "hy_slope")):
                declarations, texts = self.printer.lines([_with_exp(value, exp) for value in values])
                body = [*declarations, *(f"out[{i}] = {t};" for i, t in enumerate(texts))]
                head = f"static void hy_{name}{k}(const double *v, double *out)"
                unused = [] if any("v[" in line for line in body) else ["(void)v;"]
                self._block_text += [head, "{", *indented([*unused, *body]), "}", ""]
        return self._blocks[step]

    # -- functions

    def parameters(self) -> list[str]:
        """Dependent parameters."""
        return self.function("int", "parameters", "hy_data *m", self.steps(self.model.start.dependent))

    def evaluate(self) -> list[str]:
        """Derivatives and algebraic variables."""
        return self.function("int", "evaluate", "hy_data *m", self.steps(self.model.derivatives))

    def show(self, shown: Shown) -> list[str]:
        """Outputs of many samples: rows of time, inputs and states in, rows of outputs and what they need out."""
        given = ["time", *self.model.inputs, *self.model.states]
        taken = {self.layout.slots[name]: k for k, name in enumerate(given)}
        known = {self.layout.slots[step.variable] for step in shown.steps}
        read: dict[int, str] = {}

        def name(variable: str) -> str:
            slot = self.layout.slots[variable]
            if slot in taken:
                read[slot] = comment(variable)
                return f"s{slot}[i]"
            return f"y{slot}" if slot in known else self.slot(variable)

        printer = Printer(name)
        body = []
        for step in shown.steps:
            declarations, texts = printer.lines([step.value])
            slot = self.layout.slots[step.variable]
            body += [*declarations, f"const double y{slot} /* {comment(step.variable)} */ = {texts[0]};"]
        body += [f"out{k}[i] = {name(variable)};" for k, variable in enumerate(shown.variables)]
        self.printer.used |= printer.used
        self.printer.tables |= printer.tables
        rows = [f"const double *restrict const s{k} = in[{taken[k]}]; /* {read[k]} */" for k in sorted(read)]
        rows += [f"double *restrict const out{k} = out[{k}];" for k in range(len(shown.variables))]
        text = "\n".join([*rows, *body])
        unused = [f"(void){argument};" for argument, used in _ROWS.items() if used not in text]
        head = "static void hy_show(const double *restrict v, const double *const *in, double *const *out, int n)"
        return [head, "{", *indented([*unused, *rows, "for (int i = 0; i < n; i++) {", *indented(body), "}"]), "}", ""]

    def initialise(self) -> list[str]:
        """Solves the initial equations; relations are looked at until they agree with the values."""
        lines = [f"{self.slot(INITIAL)} = 1;", *self.steps(self.model.start.guesses)]
        lines += [f"{self.slot(BEGIN)} = {self.slot('time')};"] if BEGIN in self.layout.slots else []
        for s in self.model.samplers:
            lines += [f"{self.slot(s.flag)} = 0;", self._first_tick(s.start, s.interval, s.flag)]
        lines += [f"{self.slot(MANY)} = 0;"] if MANY in self.layout.slots else []
        lines += [f"{self.slot(warned(k))} = 0;" for k in range(len(self.model.assertions))]
        body = self.steps(self.model.start.steps)
        body = self._until_settled(body) if self.model.relations else body
        way: list[str] = []
        if self.model.homotopy:
            way = self.function("int", "begin", "hy_data *m", body)
            follow = HOMOTOPY_WAY.format(size=self.layout.size, share=self.layout.slots[HOMOTOPY])
            way += [*follow.splitlines(), ""]
            body = ["const int outcome = hy_follow(m);", "if (outcome) return outcome;"]
        lines += body
        for e in self.model.start.surplus:
            lines += self._holds(e)
        count, d, before = self.layout.count("d"), self.layout.first("d"), self.layout.first("pre")
        if count:
            lines.append(f"for (int i = 0; i < {count}; i++) v[{before} + i] = v[{d} + i]; /* pre := d */")
        lines += [line for d in self.delays for line in d.begin()]
        lines.append(f"{self.slot(INITIAL)} = 0;")
        return [*way, *self.function("int", "initialise", "hy_data *m", lines)]

    def _holds(self, e: ScalarEquation) -> list[str]:
        """A surplus initial condition: it has to follow from the others, which is checked at the start."""
        text = f"too many initial conditions, which do not fit together: {e.place.short}: remove it, or a fixed=true"
        size = min((self._nominal(name) for name in refs(e.left) | refs(e.right)), default=1.0)
        a, b = self.printer.value(e.left), self.printer.value(e.right)
        return [
            "{",
            f"    const double a = {a}, b = {b};",
            f"    if (!(fabs(a - b) <= 1e-6 * fmax({number(size)}, fmax(fabs(a), fabs(b))))) {{",
            f"        m->log(m->owner, HY_FAILURE, {quoted(text)});",
            "        return HY_ERROR;",
            "    }",
            "}",
        ]

    def _until_settled(self, body: list[str]) -> list[str]:
        text = quoted("the modes at the start do not settle: relations switch each other back and forth")
        return [
            "for (int pass = 0;; pass++) {",
            "    int changed = 0;",
            *indented([*body, *self._renew_relations("changed", self.model.start.relations)]),
            "    if (!changed) break;",
            f"    if (pass == {_START_PASSES}) {{",
            f"        m->log(m->owner, HY_FAILURE, {text});",
            "        return HY_ERROR;",
            "    }",
            "}",
        ]

    def _first_tick(self, start: Expr, interval: Expr, flag: str) -> str:
        ratio = self.printer.value(op("/", op("-", Ref("time"), start), interval))
        return f"{self.slot(tick(flag))} = fmax(0.0, ceil({ratio} - 1e-9));"

    def _renew_relations(self, changed: str, values: Sequence[Expr]) -> list[str]:
        lines = []
        for r, value in zip(self.model.relations, values, strict=True):
            name = self.slot(r.name)
            text = self.printer.value(value)
            lines += [
                "{",
                f"    const double now = {text};",
                f"    {changed} |= now != {name};",
                f"    {name} = now;",
                "}",
            ]
        return lines

    def indicators(self) -> list[str]:
        """Event indicators."""
        values = [i for r in self.model.relations for i in r.indicators]
        declarations, texts = self.printer.lines(values)
        lines = [*declarations, *(f"z[{k}] = {text};" for k, text in enumerate(texts))]
        return self.function("int", "indicators", "hy_data *m, double *z", lines)

    def update(self) -> list[str]:
        """One pass of event iteration."""
        lines, look = ["int changed = 0;", *(line for d in self.delays for line in d.before())], list[str]()
        looped = feedback(self.model)
        if self._remembers():
            lines += self._ticks() + self._sweeps()
        elif looped:
            look = self._look(looped)
            lines += [*self._ticks(), *self._agreement(looped)]
        else:
            lines += self._renew_relations("changed", [r.value for r in self.model.relations])
            lines += [*self._ticks(), *self.steps(self.model.event)]
        lines += [line for d in self.delays for line in d.after()]
        lines += self._checks() + self._reinits() + self._settled()
        lines.append("*again = changed;")
        return [*look, *self.function("int", "update", "hy_data *m, int *again", lines)]

    def _look(self, looped: Sequence[Relation]) -> list[str]:
        """A function that computes everything at an event, and then what relations would be."""
        self.needs_search = True
        lines = self.steps(self.model.event)
        lines += [f"now[{k}] = {self.printer.value(r.value)}; /* {comment(r.name)} */" for k, r in enumerate(looped)]
        return self.function("int", "modes", "hy_data *m, double *now", lines)

    def _agreement(self, looped: Sequence[Relation]) -> list[str]:
        """Relations and equations until they agree; where they keep changing, all values of the relations are tried."""
        n, size = len(looped), self.layout.size
        slots = ", ".join(str(self.layout.slots[r.name]) for r in looped)
        again = [
            f"static const int slots[{n}] = {{{slots}}};",
            f"double now[{n}], first[{size}];",
            f"hy_search(m, {size}, first, {n}, slots, hy_modes, now);",
            "break;",
        ]
        inside = [
            *self._renew_relations("moved", [r.value for r in self.model.relations]),
            *self.steps(self.model.event),
            "changed |= moved;",
            "if (!moved) break;",
            f"if (pass == {_START_PASSES}) {{",
            *indented(again),
            "}",
        ]
        return ["for (int pass = 0;; pass++) {", *indented(["int moved = 0;", *inside]), "}"]

    def _remembers(self) -> bool:
        """Whether a discrete variable that an equation states looks at its own past, as the mode of dry friction."""
        stated = {pre(name) for name in self.model.discrete if name not in self.model.clocked}
        return any(stated & sources(step) for step in self.model.event)

    def _sweeps(self) -> list[str]:
        """Relations, discrete and continuous equations until they agree, while pre() stays: only then may pre() move on
        (Modelica specification 3.6, appendix B). Else dry friction would judge by a force of the mode before.
        When-clauses join in when the others agree; change(y) would be missed before y has changed. One that takes away
        the reason for itself has acted: an odd number of sweeps ends with that."""
        body: list[str] = []
        for step in self.model.event:
            text = self.steps([step])
            clocked = isinstance(step, Assign) and step.variable in self.model.clocked
            body += ["if (phase == 1) {", *indented(text), "}"] if clocked else text
        count, d, most = self.layout.count("d"), self.layout.first("d"), _TOGETHER + 2 * self._turns()
        inside = [
            "int moved = 0;",
            f"double before[{count}];",
            f"for (int i = 0; i < {count}; i++) before[i] = v[{d} + i];",
            *(self._relations_in_turn() if self.model.relations else []),
            *body,
            f"for (int i = 0; i < {count}; i++) moved |= v[{d} + i] != before[i];",
            "changed |= moved;",
            "sweep++;",
            f"if (!moved || sweep >= {most | 1}) phase++, sweep = 0;",
        ]
        return ["for (int phase = 0, sweep = 0; phase < 3;) {", *indented(inside), "}"]

    def _relations_in_turn(self) -> list[str]:
        """All relations at once in the first sweeps. Where these go round in circles, one at a time, first those that
        cease to hold: a slider that would start forward and, once it does, backward, is stuck. Where that goes round in
        circles, too, first those that begin to hold: of two sliders on one shaft none starts while the other holds it.
        """
        n = len(self.model.relations)
        self.needs_turns = True
        slots = ", ".join(str(self.layout.slots[r.name]) for r in self.model.relations)
        lines = [f"static const int slots[{n}] = {{{slots}}};", f"double now[{n}];"]
        for k, r in enumerate(self.model.relations):
            lines.append(f"now[{k}] = {self.printer.value(r.value)}; /* {comment(r.name)} */")
        first, second = _TOGETHER, _TOGETHER + self._turns()
        return [*lines, f"moved = hy_renew(v, {n}, slots, now, (sweep >= {first}) + (sweep >= {second}));"]

    def _turns(self) -> int:
        """Sweeps in which relations take turns, in which each may change its value some times."""
        return 4 * len(self.model.relations) + 4

    def _ticks(self) -> list[str]:
        lines = []
        for s in self.model.samplers:
            due = self._due(s.start, s.interval, s.flag)
            lines += [f"{self.slot(s.flag)} = {self.slot('time')} >= {due} ? 1.0 : 0.0;"]
            lines += [f"if ({self.slot(s.flag)} != 0) {self.slot(tick(s.flag))} += 1;"]
        return lines

    def _due(self, start: Expr, interval: Expr, flag: str) -> str:
        return self.printer.value(op("+", start, op("*", Ref(tick(flag)), interval)), 4)

    def _reinits(self) -> list[str]:
        lines = []
        for k, r in enumerate(self.model.reinits):
            active, value = self.printer.truth(r.active), self.printer.value(r.value)
            lines += [f"const int fires{k} = {active}; /* {comment(r.place.short)} */"]
            lines += [f"const double new{k} = fires{k} ? {value} : 0.0;"]
        for k, r in enumerate(self.model.reinits):
            lines += [f"if (fires{k}) {{ changed = 1; {self.slot(r.state)} = new{k}; }}"]
        return lines

    def _settled(self) -> list[str]:
        count, d, before = self.layout.count("d"), self.layout.first("d"), self.layout.first("pre")
        return [f"for (int i = 0; i < {count}; i++) changed |= v[{d} + i] != v[{before} + i];"] if count else []

    def _checks(self) -> list[str]:
        """Assertions inside when-clauses."""
        lines = []
        for active, a in self.model.checks:
            condition = op("and", active, op("not", a.condition))
            lines += [f"if ({self.printer.truth(condition)}) {{", *indented(self._report(a)), "}"]
        return lines

    def completed_step(self) -> list[str]:
        """Assertions, looked at once per step: a warning is given when the condition begins to fail."""
        lines = [line for d in self.delays for line in d.keep()]
        for k, a in enumerate(self.model.assertions):
            mark = self.slot(warned(k))
            lines += [f"if (!({self.printer.truth(a.condition)})) {{"]
            if a.level == "warning":
                report = [f"if ({mark} == 0) {{", *indented(self._report(a)), "}", f"{mark} = 1;"]
                lines += [*indented(report), "} else {", f"    {mark} = 0;", "}"]
            else:
                lines += [*indented(self._report(a)), "}"]
        return self.function("int", "completed_step", "hy_data *m", lines)

    def _report(self, a: Assertion) -> list[str]:
        parts = list(_texts(a.message))
        pattern = "".join("%.9g" if not isinstance(p, Text) else p.value.replace("%", "%%") for p in parts)
        numbers = "".join(f", {self.printer.value(p)}" for p in parts if not isinstance(p, Text))
        time = f", {self.slot('time')}"
        level = "HY_WARNING" if a.level == "warning" else "HY_FAILURE"
        lines = [
            "char text[400];",
            f"/* {comment(a.place.short)} */",
            f"snprintf(text, sizeof text, {quoted(pattern + ' (t = %.9g s)')}{numbers}{time});",
            f"m->log(m->owner, {level}, text);",
        ]
        return lines if a.level == "warning" else [*lines, "return HY_ERROR;"]

    def next_time_event(self) -> list[str]:
        """Earliest instant after now at which a sampler ticks or a relation of time changes."""
        lines = ["double next = INFINITY;"]
        for s in self.model.samplers:
            lines.append(f"next = fmin(next, {self._due(s.start, s.interval, s.flag)});")
        for r in self.model.relations:
            if r.deadline is not None:
                text = self.printer.value(r.deadline, 4)
                lines.append(f"if ({text} > {self.slot('time')}) next = fmin(next, {text});")
        lines += [line for d in self.delays for line in d.next_event()]
        lines.append("return next;")
        return self.function("double", "next_time_event", "const hy_data *m", lines, returns=False)

    def function(self, kind: str, name: str, arguments: str, body: Sequence[str], returns: bool = True) -> list[str]:
        """A static function of hy_model; v is the block."""
        text = "\n".join(body)
        opening = ["double *const v = m->v;"] if kind == "int" else ["const double *const v = m->v;"]
        if "v[" not in text:
            opening = [] if "m->" in text else ["(void)m;"]
        if "z" in arguments and "z[" not in text:
            opening.append("(void)z;")
        closing = ["return HY_OK;"] if returns else []
        return [f"static {kind} hy_{name}({arguments})", "{", *indented([*opening, *body, *closing]), "}", ""]

    def preamble(self) -> list[str]:
        """Helpers that the printed functions use; call after printing them."""
        lines: list[str] = []
        for name, values in self.printer.tables.items():
            lines += [f"static const double {name}[{len(values)}] = {{{', '.join(map(number, values))}}};", ""]
        for name, text in (HELPERS | TEXTS).items():
            if name in self.printer.used:
                lines += [text, ""]
        if self.needs_turns:
            lines.append(TURNS)
        if self.needs_search or self.model.homotopy:
            lines.append(SILENT)
        if self.needs_search:
            lines.append(SEARCH)
        if self.needs_solve:
            lines += [SOLVERS, *self._outcome("hy_singular", "HY_ERROR", "singular", "HY_FAILURE")]
        if self.needs_nearest:
            lines.append(NEAREST)
        if self.needs_newton:
            lines += [NEWTON, OPERATING_POINT]
            lines += self._outcome("hy_not_converged", "HY_RETRY", "no convergence", "HY_WARNING")
        return [*lines, *self._block_text]

    def _outcome(self, name: str, outcome: str, word: str, level: str) -> list[str]:
        if not any(s.linear != (name == "hy_not_converged") for s in self.model.loops):
            return []
        return [
            f"static int {name}(hy_data *m, const char *what)",
            "{",
            "    char text[400];",
            f'    snprintf(text, sizeof text, "{word} at t = %.9g s: %s", m->v[0], what);',
            f"    m->log(m->owner, {level}, text);",
            f"    return {outcome};",
            "}",
            "",
        ]


def _with_exp(expr: Expr, name: str) -> Expr:
    """Exponentials by a function that knows the limit of the loop."""

    def change(node: Expr) -> Expr | None:
        if isinstance(node, Op) and node.name == "exp":
            return Op(name, (_with_exp(node.args[0], name), Ref(LIMIT)))
        return None

    return rebuild(expr, change)


def indented(lines: Iterable[str]) -> list[str]:
    """Lines moved in by one level."""
    return ["    " + line if line else line for line in lines]


def _texts(message: Expr) -> Iterator[Expr]:
    """Parts of a message: texts and numbers."""
    if isinstance(message, Op) and message.name == "+":
        for a in message.args:
            yield from _texts(a)
    elif isinstance(message, Op) and message.name == "String":
        yield message.args[0]
    elif isinstance(message, Num):
        return
    else:
        yield message
