"""Reference pages from the program itself: every public function from its docstring, every command from its help.

Run: ``python -m docs.generate.reference [FOLDER]``.
"""

from __future__ import annotations

import contextlib
import doctest
import inspect
import io
import os
import re
import sys
from pathlib import Path
from typing import Any

import hystid
from hystid.cli.run import run

COMMANDS = (
    "check",
    "identify",
    "validate",
    "diagnose",
    "build",
    "simulate",
    "regress",
    "study grid",
    "study mass",
    "demo",
    "cache",
)
STUDY = {"study.grid": "grid", "study.mass": "mass"}
RESULTS = ("summary", "plot", "plots", "save", "report")


def api() -> str:
    """Markdown of every public name."""
    names = [name for name in hystid.__all__ if not name.startswith("__") and name != "study"]
    functions = {n: getattr(hystid, n) for n in names if inspect.isfunction(getattr(hystid, n))}
    functions |= {name: getattr(hystid.study, attribute) for name, attribute in STUDY.items()}
    classes = {n: getattr(hystid, n) for n in names if inspect.isclass(getattr(hystid, n))}
    parts = ["# Python reference", "`import hystid` gives everything on this page. Arrays are float64 in SI units."]
    parts += ["## Functions", *(section(f"hystid.{name}", thing) for name, thing in functions.items())]
    from hystid.results import Result

    shared = [section(f"result.{name}", getattr(Result, name)) for name in RESULTS]
    parts += ["## What every result can do", inspect.getdoc(Result) or "", *shared, "## Types"]
    parts += [section(f"hystid.{name}", thing) for name, thing in classes.items()]
    return "\n\n".join(parts) + "\n"


def section(name: str, thing: Any) -> str:
    """Signature and docstring, its example as code."""
    try:
        signature = str(inspect.signature(thing)) if not inspect.isclass(thing) else ""
    except ValueError:
        signature = ""
    short = re.sub(r"(: |-> )'([^']*)'", r"\1\2", signature)
    head = f"### {name} {{ #{name} }}"
    return "\n\n".join([head, f"```python\n{name}{_wrapped(short)}\n```", docstring(inspect.getdoc(thing) or "")])


def _wrapped(signature: str) -> str:
    inside, _, returned = signature.rpartition(" -> ") if " -> " in signature else (signature, "", "")
    if len(signature) < 90 or not inside.startswith("("):
        return signature
    pieces, depth, start = [], 0, 1
    for k, letter in enumerate(inside[1:-1], start=1):
        depth += letter in "[("
        depth -= letter in "])"
        if letter == "," and not depth:
            pieces.append(inside[start:k].strip())
            start = k + 1
    pieces.append(inside[start:-1].strip())
    return "(\n" + "".join(f"    {piece},\n" for piece in pieces) + f") -> {returned}"


def docstring(text: str) -> str:
    """A docstring as Markdown: prose as it is, its example as a block of code."""
    examples = doctest.DocTestParser().get_examples(text)
    prose = text.partition(">>>")[0].rstrip() if examples else text
    prose = re.sub(r"``(.+?)``", r"`\1`", prose)
    code = "".join(
        f">>> {example.source.rstrip()}\n".replace("\n", "\n... ").rstrip(". ") + "\n" + example.want
        if "\n" in example.source.rstrip()
        else f">>> {example.source.rstrip()}\n{example.want}"
        for example in examples
    )
    return prose + (f"\n\n```pycon\n{code}```" if code else "")


def commands() -> str:
    """Markdown of the help of every command."""
    os.environ["COLUMNS"] = "100"
    parts = ["# Commands", "Exit codes: 0 fine, 1 finding or failure, 2 wrong usage, 130 interrupted."]
    for name in COMMANDS:
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
            code = run([*name.split(), "--help"])
        if code == 0:
            parts.append(f"## hystid {name}\n\n```text\n{said.getvalue().strip()}\n```")
    return "\n\n".join(parts) + "\n"


def main(folder: Path) -> list[Path]:
    """Write ``api.md`` and ``commands.md``; returns them."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (("api.md", api()), ("commands.md", commands())):
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / "api.md", folder / "commands.md"]


if __name__ == "__main__":
    for page in main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/generated")):
        print(page)
