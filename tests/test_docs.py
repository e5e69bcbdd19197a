"""The documentation keeps up with the program: commands exist, links lead somewhere, every page is listed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.generate import imports, reference
from hystid.cli.run import run, spread

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^```[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)


def command_lines() -> list[tuple[str, str]]:
    """(page, command) of every ``hystid ...`` in a block of code; lines that end in a backslash are joined."""
    found = []
    for page in PAGES:
        for block in FENCE.findall(page.read_text(encoding="utf-8")):
            for line in block.replace("\\\n", " ").splitlines():
                if re.match(r"\s*hystid \w", line):
                    found.append((page.name, line.partition("#")[0].strip()))
    return found


@pytest.mark.parametrize(("page", "line"), command_lines(), ids=lambda value: value if " " not in value else "")
def test_every_command_in_the_docs_exists_with_its_options(
    page: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [word for word in line.replace("&&", " ").split() if word != "..."]
    names = [word for word in words[1:3] if re.fullmatch("[a-z]+", word)]
    group = names[:2] if names[0] == "study" else names[:1]
    assert run([*group, "--help"]) == 0, f"{page}: {line}"
    known = set(re.findall(r"(?<![\w-])(--?[a-z][\w-]*)", capsys.readouterr().out))
    asked = {word for word in spread(words[1:]) if re.fullmatch(r"--?[a-z][\w-]*", word)}
    assert asked <= known, f"{page}: {line}"


def test_every_page_is_in_the_list_of_contents() -> None:
    listed = re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    pages = {path.name for path in (ROOT / "docs").glob("*.md")}
    assert pages <= set(listed)
    assert {name for name in listed if "/" not in name} <= pages


def test_links_between_pages_lead_somewhere() -> None:
    for page in PAGES:
        text = FENCE.sub("", page.read_text(encoding="utf-8"))
        for target in re.findall(r"\]\(([^)#\s]+)", text):
            made = target.startswith(("generated/", "http", "mailto:"))
            assert made or (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_reference_names_everything_public() -> None:
    text = reference.api()
    for name in ("diagnose", "identify", "read", "study.grid"):
        assert f"### hystid.{name} " in text
    assert "```pycon\n>>> import hystid" in text
    assert "## hystid diagnose" in reference.commands()


def test_the_import_graph_draws_every_package(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = imports.main(tmp_path).read_text(encoding="utf-8")
    assert "| `diagnosis` |" in page
    assert ">diagnosis</text>" in (tmp_path / "imports.svg").read_text(encoding="utf-8")
    assert "pairs of packages" in capsys.readouterr().out


def test_every_constant_that_decides_stands_where_the_table_says() -> None:
    table = (ROOT / "docs" / "decisions.md").read_text(encoding="utf-8")
    module, missing = "", []
    for row in re.findall(r"^\| (`[^|]+`) \|", table, re.MULTILINE):
        for name in re.findall(r"`([\w.]+)`", row):
            place, _, constant = name.rpartition(".")
            module = place or module
            texts = (path.read_text(encoding="utf-8") for path in (ROOT / "hystid").rglob(f"{module}.py"))
            if not any(re.search(rf"\b{constant}\b", text) for text in texts):
                missing.append(f"{module}.{constant}")
    assert not missing
