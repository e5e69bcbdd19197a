"""The shape of the package: imports go one way, one place per outside library, no leftovers."""

from __future__ import annotations

import ast
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "hystid"

# Lower may not import higher. A name is a module or a package directly below hystid, or a module within a package.
LAYERS = [
    {"errors", "numeric"},
    {"files", "leastsquares", "limits", "progress", "units", "modelcode"},
    {"cache", "child", "outputs", "rotation"},
    {"batch", "toolchain"},
    {"results", "smoothing"},
    {"recording"},
    {"turning_points", "comparison", "excitation", "processing"},
    {"consistency"},
    {"modelica", "networks", "compiled"},
    {"surrogate"},
    {"fmu"},
    {"simulation", "building", "modelica_text"},
    {"rig"},
    {"validation"},
    {"identification", "diagnosis"},
    {"study"},
    {"report"},
    {"virtual_experiment"},
    {"cli", "pytest_plugin"},
    {"__main__"},
]
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}

# Outside library -> the only modules that may import it (a front-end or format change then touches one file).
ONLY_IN = {
    "rumoca": {"modelica"},
    "casadi": set(),  # the tests alone, to check derivatives
    "torch": {"networks"},
    "pint": {"units"},
    "plotly": {"report"},
    "onnx": {"networks", "surrogate"},
    "onnxruntime": {"networks"},
    "distributed": {"study"},
    "typer": {"cli"},
}


def modules() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def top(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(path: Path) -> list[tuple[int, str]]:
    """Every absolute import of the file, those inside functions too: (line, dotted name)."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            base = node.module or ""
            found += [(node.lineno, f"{base}.{alias.name}" if base == "hystid" else base) for alias in node.names]
    return found


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_downward(path: Path) -> None:
    here = top(path)
    if here == "__init__":
        return
    assert here in RANK, f"{here}: say in LAYERS where this module stands"
    for line, name in imports(path):
        if name.startswith("hystid."):
            there = name.split(".")[1]
            if there.startswith("__") or there == here:
                continue
            assert there in RANK, f"{path.name}:{line} imports unknown hystid.{there}"
            assert RANK[there] < RANK[here], f"{path.name}:{line}: {here} may not import {there}"


def test_every_layer_exists() -> None:
    assert RANK.keys() == {top(path) for path in modules()} - {"__init__"}


def graph(package: Path) -> dict[str, set[str]]:
    """Module -> modules of the package that it imports, at its head, in functions, and for types alone."""
    names = {".".join(p.relative_to(package.parent).with_suffix("").parts).removesuffix(".__init__"): p
             for p in package.rglob("*.py")}  # fmt: skip
    found: dict[str, set[str]] = {name: set() for name in names}
    for here, path in names.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                wanted = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                wanted = [f"{node.module}.{alias.name}" for alias in node.names]
            else:
                continue
            for there in wanted:
                while there and there not in names:  # a name within a module
                    there = there.rpartition(".")[0]
                parents = {".".join(there.split(".")[:k]) for k in range(1, there.count(".") + 1)}  # these run first
                own = {".".join(here.split(".")[:k]) for k in range(1, here.count(".") + 1)}
                found[here] |= {there, *(parents - own)} - {"", here}
    return found


def circle(package: Path) -> list[str]:
    """Modules that import each other, first one again at the end; [] where there are none."""
    try:
        TopologicalSorter(graph(package)).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_modules_import_each_other() -> None:
    # One way up is none of imports: a result finds its report by name when it is shown (hystid.results).
    assert circle(PACKAGE) == []


def test_circles_are_seen_inside_functions(tmp_path: Path) -> None:
    package = tmp_path / "rig"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "a.py").write_text("from rig.b import go\n")
    (package / "b.py").write_text("def go():\n    from rig.c import stop\n")
    (package / "c.py").write_text("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from rig import a\n")
    assert sorted(set(circle(package))) == ["rig.a", "rig.b", "rig.c"]
    (package / "c.py").write_text("stop = 0\n")
    assert circle(package) == []


# The stages of the diagnosis: a later one may import an earlier one, never the other way.
STAGES = ["prepare", "model", "fit", "decide", "prove", "tell"]


@pytest.mark.parametrize("path", sorted((PACKAGE / "diagnosis").rglob("*/*.py")), ids=lambda path: path.stem)
def test_stages_of_the_diagnosis_go_one_way(path: Path) -> None:
    here = STAGES.index(path.parent.name)
    for line, name in imports(path):
        if name.startswith("hystid.diagnosis."):
            there = name.split(".")[2]
            assert there in STAGES and STAGES.index(there) <= here, f"{path.name}:{line}: {path.parent.name} > {there}"


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_outside_libraries_have_one_home(path: Path) -> None:
    for line, name in imports(path):
        homes = ONLY_IN.get(name.split(".")[0])
        assert homes is None or top(path) in homes, f"{path.name}:{line}: {name} belongs in {homes}"


def test_no_file_is_too_long_to_read() -> None:
    # 450 lines are the aim; the largest file of the code bases that this layout follows has 650.
    long = {str(p.relative_to(ROOT)): n for p in modules() if (n := len(p.read_text().splitlines())) > 580}
    assert not long


# File names that stand in several folders still; the list may only become shorter.
SHARED_NAMES = {
    "curves.py", "independence.py", "layout.py", "limits.py", "result.py", "tables.py", "types.py", "worker.py",
}  # fmt: skip


def test_a_file_name_stands_once() -> None:
    names = [path.name for path in modules() if not path.stem.startswith("__")]
    assert {name for name in names if names.count(name) > 1} <= SHARED_NAMES


def test_a_public_class_name_stands_once() -> None:
    found = [node.name for path in modules() for node in ast.parse(path.read_text(encoding="utf-8")).body
             if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]  # fmt: skip
    assert {name for name in found if found.count(name) > 1} == set()


# Functions with more than seven parameters: entry functions, whose parameters are the options that users see. The list
# may only become shorter.
OPTIONS = {
    "compiled.py": {"simulate"},
    "identification/entry.py": {"identify"},
    "recording/reading.py": {"read"},
    "study/studies.py": {"grid", "mass"},
    "validation/cases.py": {"validate"},
}


def test_functions_take_at_most_seven_parameters() -> None:
    found = []
    for path in modules():
        here = path.relative_to(PACKAGE).as_posix()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
                count = len([name for name in names if name not in ("self", "cls")])
                if count > 7 and node.name not in OPTIONS.get(here, set()):
                    found.append(f"{here}:{node.lineno} {node.name}: {count}")
    assert not found


def test_every_public_function_says_what_it_does() -> None:
    silent = []
    for path in modules():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            public = isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
            if public and not ast.get_docstring(node):
                silent.append(f"{path.relative_to(ROOT)}:{node.lineno} {node.name}")
    assert not silent


# Files whose public functions do not all say what they raise; the list may only become shorter.
SILENT = {"diagnosis/fit/refit.py"}


def test_public_functions_say_what_they_raise() -> None:
    # Commands say it by their exit codes.
    silent = []
    for path in modules():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            public = isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and top(path) != "cli"
            raises = public and any(isinstance(inner, ast.Raise) for inner in ast.walk(node))
            if raises and not re.search("[Rr]aise|[Rr]efuse|[Ee]rror", ast.get_docstring(node) or ""):
                silent.append(path.relative_to(PACKAGE).as_posix())
    assert set(silent) <= SILENT


def test_nothing_unfinished() -> None:
    marks = re.compile(r"\b(TODO|FIXME|XXX|NotImplementedError)\b")
    texts = [
        p
        for folder in ("hystid", "modelica")
        for p in (ROOT / folder).rglob("*")
        if p.suffix in {".py", ".c", ".h", ".mo"}
    ]
    found = [
        f"{p.relative_to(ROOT)}:{i}"
        for p in texts
        for i, s in enumerate(p.read_text().splitlines(), 1)
        if marks.search(s)
    ]
    assert not found
