"""Forward and adjoint directional derivatives of (dx, y), printed from the steps of evaluation.

Each step y = f(a, b, ...) becomes sens[y] = df/da seed[a] + ..., in order forward and in reverse for the adjoint;
a block of simultaneous equations r(y, a) = 0 becomes a linear solution with its own jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence

from hystid.modelica.blocks import Assign, Solve, Step, sources, targets
from hystid.modelica.c_expr import comment
from hystid.modelica.differentiation import gradient
from hystid.modelica.emit_c import Emitter, indented
from hystid.modelica.expr import Expr, Num


class DerivativeEmitter:
    """Prints hy_forward and hy_adjoint of one model through its value printer."""

    def __init__(self, emitter: Emitter) -> None:
        self.emitter = emitter
        self._known: dict[Expr, dict[str, Expr]] = {}
        m = emitter.model
        self.steps: tuple[Step, ...] = (*m.start.dependent, *m.derivatives)
        self.computed = {t for s in self.steps for t in targets(s)}
        self.seeded = {"time", *m.settable, *m.computed, *m.inputs, *m.states, *m.discrete} - self.computed

    def forward(self) -> list[str]:
        """sens = d(dx, y) . seed."""
        lines = [line for step in self.steps for line in self._forward(step)]
        if not any("seed[" in line for line in lines):
            lines.insert(0, "(void)seed;")
        if not any("sens[" in line for line in lines):
            lines.insert(0, "(void)sens;")
        return self.emitter.function("int", "forward", "hy_data *m, const double *seed, double *sens", lines)

    def adjoint(self) -> list[str]:
        """sens += seed . d(dx, y)."""
        layout = self.emitter.layout
        lines = [f"double b[{layout.size}] = {{0}};"]
        for section in ("dx", "y"):
            first, count = layout.sections[section]
            if count:
                lines.append(f"for (int i = {first}; i < {first + count}; i++) b[i] = seed[i];")
        for step in reversed(self.steps):
            lines += self._adjoint(step)
        lines.append("sens[0] += b[0];")
        for section in ("p", "u", "x", "d"):
            first, count = layout.sections[section]
            if count:
                lines.append(f"for (int i = {first}; i < {first + count}; i++) sens[i] += b[i];")
        if not any("seed[" in line for line in lines):
            lines.insert(0, "(void)seed;")
        return self.emitter.function("int", "adjoint", "hy_data *m, const double *seed, double *sens", lines)

    # -- one step

    def _names(self, step: Step) -> list[str]:
        slots = self.emitter.layout.slots
        return sorted((n for n in sources(step) if n in self.computed or n in self.seeded), key=slots.__getitem__)

    def _gradient(self, value: Expr, names: Sequence[str]) -> list[tuple[str, Expr]]:
        if value not in self._known:
            self._known[value] = gradient(value)
        found = self._known[value]
        return [(n, found[n]) for n in names if n in found]

    def _cell(self, name: str, array: str | None = None) -> str:
        slot = self.emitter.layout.slots[name]
        chosen = array or ("sens" if name in self.computed else "seed")
        return f"{chosen}[{slot} /* {comment(name)} */]"

    def _product(self, text: str, d: Expr, cell: str) -> str:
        if isinstance(d, Num) and d.value in (1.0, -1.0):
            return cell if d.value == 1.0 else f"-{cell}"
        return f"({text}) * {cell}"

    def _forward(self, step: Step) -> list[str]:
        names = self._names(step)
        if isinstance(step, Assign):
            terms = self._gradient(step.value, names)
            declarations, texts = self.emitter.printer.lines([d for _, d in terms])
            products = [self._product(t, d, self._cell(n)) for t, (n, d) in zip(texts, terms, strict=True)]
            return [*declarations, f"{self._cell(step.variable, 'sens')} = {' + '.join(products) or '0'};"]
        return self._forward_block(step, names)

    def _forward_block(self, step: Solve, names: Sequence[str]) -> list[str]:
        self.emitter.needs_solve = True
        n = len(step.variables)
        rows = [self._gradient(r, names) for r in step.residuals]
        entries = [e for row in step.jacobian for e in row]
        declarations, texts = self.emitter.printer.lines([*entries, *(d for row in rows for _, d in row)])
        rest = iter(texts[n * n :])
        sums = [" + ".join(self._product(next(rest), d, self._cell(name)) for name, d in row) or "0" for row in rows]
        return [
            "{",
            *indented(declarations),
            f"    double A[{n * n}] = {{{', '.join(texts[: n * n])}}};",
            f"    double b[{n}] = {{{', '.join(sums)}}};",
            f"    if (hy_solve({n}, A, b)) return HY_ERROR;",
            *(f"    {self._cell(name, 'sens')} = -b[{i}];" for i, name in enumerate(step.variables)),
            "}",
        ]

    def _adjoint(self, step: Step) -> list[str]:
        names = self._names(step)
        if isinstance(step, Assign):
            terms = self._gradient(step.value, names)
            declarations, texts = self.emitter.printer.lines([d for _, d in terms])
            bar = self._cell(step.variable, "b")
            pairs = zip(texts, terms, strict=True)
            return [*declarations, *(f"{self._cell(n, 'b')} += {self._product(t, d, bar)};" for t, (n, d) in pairs)]
        return self._adjoint_block(step, names)

    def _adjoint_block(self, step: Solve, names: Sequence[str]) -> list[str]:
        self.emitter.needs_solve = True
        n = len(step.variables)
        rows = [self._gradient(r, names) for r in step.residuals]
        transposed = [step.jacobian[j][i] for i in range(n) for j in range(n)]
        declarations, texts = self.emitter.printer.lines([*transposed, *(d for row in rows for _, d in row)])
        rest = iter(texts[n * n :])
        lines = [
            "{",
            *indented(declarations),
            f"    double A[{n * n}] = {{{', '.join(texts[: n * n])}}};",
            f"    double l[{n}] = {{{', '.join(self._cell(name, 'b') for name in step.variables)}}};",
            f"    if (hy_solve({n}, A, l)) return HY_ERROR;",
        ]
        for i, row in enumerate(rows):
            for name, d in row:
                lines.append(f"    {self._cell(name, 'b')} -= {self._product(next(rest), d, f'l[{i}]')};")
        return [*lines, "}"]
