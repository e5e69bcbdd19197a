"""Who imports whom below ``hystid``, as a picture, and how long each package is, as a table.

Run: ``python -m docs.generate.imports [FOLDER]``. The layers are those that ``tests/test_architecture.py`` checks.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

from benchmarks.pictures import FONT, INK, text
from tests.test_architecture import LAYERS, PACKAGE, RANK, imports, modules, top

BOX, ROW, LEFT = (128, 32), 78, 20


def edges() -> dict[tuple[str, str], int]:
    """(importing, imported) -> number of import statements; ``errors``, which all import, is left out."""
    found: dict[tuple[str, str], int] = {}
    for path in modules():
        here = top(path)
        for _, name in imports(path):
            there = name.split(".")[1] if name.startswith("hystid.") else ""
            if there in RANK and here in RANK and there not in (here, "errors"):
                found[here, there] = found.get((here, there), 0) + 1
    return found


def lines() -> dict[str, int]:
    """Package -> lines of Python and of C, the headers of the standard apart."""
    counted: dict[str, int] = {}
    for path in PACKAGE.rglob("*"):
        if path.suffix in (".py", ".c", ".h") and "fmi" not in path.parent.name.split("-"):
            counted[top(path)] = counted.get(top(path), 0) + len(path.read_text(encoding="utf-8").splitlines())
    return counted


def needed(found: dict[tuple[str, str], int]) -> list[tuple[str, str]]:
    """The pairs that do not follow from others: a package may import all that lies below a package it imports."""
    direct = {here: {b for a, b in found if a == here} for here, _ in found}
    below: dict[str, set[str]] = {}  # all that a package reaches, from the lowest up
    for name in sorted(direct, key=RANK.__getitem__):
        below[name] = direct[name].union(*(below.get(there, set()) for there in direct[name]))
    return sorted((a, b) for a, b in found if not any(b in below.get(other, ()) for other in direct[a]))


def picture(found: dict[tuple[str, str], int], counted: dict[str, int]) -> str:
    """SVG: one row per layer, the highest on top; an arrow for every pair in ``needed``; lines in each box."""
    shown = {name for pair in found for name in pair}
    rows = [row for layer in reversed(LAYERS) if (row := sorted(layer & shown))]
    width = LEFT + max(map(len, rows)) * (BOX[0] + 16)
    place = {
        name: (LEFT + k * (BOX[0] + 16) + (width - LEFT - len(row) * (BOX[0] + 16)) / 2, 16 + r * ROW)
        for r, row in enumerate(rows)
        for k, name in enumerate(row)
    }
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {16 + len(rows) * ROW}" role="img">',
        "<title>Imports between the packages of hystid</title>", f'<rect width="{width}" height="100%" fill="#fff"/>',
    ]  # fmt: skip
    for here, there in needed(found):
        (x0, y0), (x1, y1) = place[here], place[there]
        a, b = x0 + BOX[0] / 2, x1 + BOX[0] / 2
        curve = f"M{a:.0f} {y0 + BOX[1]}C{a:.0f} {y0 + BOX[1] + 40} {b:.0f} {y1 - 40} {b:.0f} {y1}"
        wide = min(1.0 + 0.15 * found[here, there], 4.0)
        parts.append(f'<path d="{curve}" fill="none" stroke="#6b7885" stroke-width="{wide:.1f}" opacity=".7"/>')
    for name, (x, y) in place.items():
        style = f'width="{BOX[0]}" height="{BOX[1]}" rx="6" fill="#eef4fb" stroke="#1668c7" {FONT} color="{INK}"'
        parts.append(f'<rect x="{x:.0f}" y="{y}" {style}/>')
        parts.append(text(x + BOX[0] / 2, y + 14, name, 12, "middle"))
        parts.append(text(x + BOX[0] / 2, y + 26, f"{counted[name]} lines", 9, "middle"))
    return "\n".join([*parts, "</svg>"]) + "\n"


def words() -> dict[str, str]:
    """First sentence of every package and module directly below ``hystid``."""
    said = {}
    for name in RANK:
        path = PACKAGE / name / "__init__.py" if (PACKAGE / name).is_dir() else PACKAGE / f"{name}.py"
        if path.exists():
            doc = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            said[name] = " ".join(doc.split("\n\n")[0].split())
    return said


def main(folder: Path) -> Path:
    """Write ``imports.svg`` and ``imports.md``; returns the page."""
    folder.mkdir(parents=True, exist_ok=True)
    found, counted, said = edges(), lines(), words()
    (folder / "imports.svg").write_text(picture(found, counted), encoding="utf-8")
    rows = [f"| `{n}` | {counted.get(n, 0)} | {said.get(n, '')} |" for layer in reversed(LAYERS) for n in sorted(layer)]
    table = "\n".join(["| package | lines | what it is |", "|---|---|---|", *rows])
    page = (
        "# Packages and imports\n\nImports go downward only; `tests/test_architecture.py` checks it. A thicker line is"
        " more imports; what follows from others is not drawn.\n\n![Imports between the packages](imports.svg)\n\n"
        f"{table}\n\nIn all {sum(counted.values())} lines of Python and C.\n"
    )
    (folder / "imports.md").write_text(page, encoding="utf-8")
    print(f"{sum(counted.values())} lines, {len(found)} pairs of packages that import")
    return folder / "imports.md"


if __name__ == "__main__":
    print(main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/generated")))
