"""Names and texts from data: none of them chooses where a file is written, none reaches a terminal unescaped."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hystid.cli.options import show
from hystid.diagnosis import diagnose
from hystid.diagnosis.model.library import load_effects
from hystid.errors import FmuError, HystidError, RecordingError, UsageError, printable
from hystid.files import _mark, _sweep, atomic, inside, safe_name, write_text
from hystid.recording import Recording, read_all

HOSTILE = [
    "../evil",
    "..",
    ".",
    "",
    "/etc/evil",
    "a/../../evil",
    "..\\evil",
    "C:\\evil",
    "con",
    "nul.txt",
    "\x1b[2J",
    "a\0b",
]
HOSTILE += ["\x1b[2J", "a\0b"]
HOSTILE += ["a\nb", ".hidden", "x" * 70_000, "ü" * 300, "\ud800", "\u202egnp.exe", "a ", "-rf", "~root", "$(id)", "*?"]


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_names_become_file_names(tmp_path: Path, text: str) -> None:
    path = inside(tmp_path, f"mismatch_{safe_name(text)}.csv")
    write_text(path, "here")
    assert [found.read_text() for found in tmp_path.iterdir()] == ["here"]
    assert path.name.isprintable()


@given(st.text(st.characters(), max_size=300), st.text(st.characters(), max_size=300))
def test_names_stay_apart_and_inside(one: str, other: str) -> None:
    names = [safe_name(text) for text in (one, other)]
    assert (names[0] == names[1]) == (one == other)
    for name in names:
        assert name == Path(name).name and 0 < len(name.encode()) <= 140
        assert not name.startswith(".") and "\\" not in name and ":" not in name


@pytest.mark.parametrize(
    "name", ["rec_1", "chirp 5N", "run-2 (repeated)", "Messung_ä", "a.b", "x=3,y=4", "60N+10N", "a@60N"]
)
def test_ordinary_names_stay(name: str) -> None:
    assert safe_name(name) == name


@pytest.mark.parametrize("name", ["../a", "/a", "a/b", "", ".", "..", "a/.."])
def test_no_path_leads_out_of_the_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match="outside this folder"):
        inside(tmp_path, name)


def test_groups_of_a_tdms_file_cannot_choose_a_path(tmp_path: Path) -> None:
    """The diagnosis writes one table per group; a group's name may hold anything but a closing quote."""
    nptdms = pytest.importorskip("nptdms", reason="needs the extra tdms")
    rng, t = np.random.default_rng(1), np.arange(2500) / 1000.0
    channels = []
    for group in ("../../evil", f"{tmp_path}/absolute"):
        x = 1e-3 * np.sin(2 * np.pi * (5 + 8 * t) * t)
        v, a = np.gradient(x, t), np.gradient(np.gradient(x, t), t)
        force = 2.0 * a + 6.0 * v + 9000.0 * x + 0.05 * rng.standard_normal(t.size)
        for name, unit, values in (("t", "s", t), ("F", "N", force), ("x", "m", x), ("v", "m/s", v), ("a", "m/s2", a)):
            channels.append(nptdms.ChannelObject(group, name, values, properties={"unit_string": unit}))
    (tmp_path / "in").mkdir()
    (tmp_path / "work").mkdir()
    with nptdms.TdmsWriter(tmp_path / "in" / "evil.tdms") as writer:
        writer.write_segment(channels)
    recordings = read_all([tmp_path / "in" / "evil.tdms"])
    before = {path for path in tmp_path.rglob("*")}
    out = tmp_path / "work" / "out"
    ids = sorted({effect.id for effect in load_effects()} - {"preload"})
    diagnose(
        recordings,
        exclude=ids,
        model="HystId.Oscillators.Linear",
        parameters={"m": 2.0, "B": 6.0, "Kl": 9000.0},
        out=out,
    )
    new = {path for path in tmp_path.rglob("*")} - before - {out}
    assert new and all(path.parent == out for path in new), new
    assert len([path for path in new if path.name.startswith("mismatch_")]) == 2


@pytest.mark.parametrize("error", [FmuError, RecordingError, UsageError])
def test_messages_are_short_and_print(error: type[HystidError]) -> None:
    text = str(error(f"bad.csv: no column {'N' * 70_000}; it has \x1b[31mred\x07 and \u202eleft\ud800"))
    assert len(text) < 500 and text.isprintable()
    assert "\\x1b" in text and "N[...]N" in text
    assert len(str(error("word " * 20_000))) < 2100
    assert str(error("first", "second")) == "first\nsecond"
    # a name cannot begin a line of its own
    assert str(error("version '\n' of the file")) == "version '\\n' of the file"


@given(st.text(st.characters()))
def test_whatever_is_shown_prints(text: str) -> None:
    assert printable(text).isprintable()
    assert printable(text, 40) == printable(printable(text, 40), 400)


def test_the_name_of_a_recording_prints() -> None:
    t = np.arange(20) / 10
    assert Recording("a\x1b[2J\nb", t).name.isprintable()
    assert len(Recording("n" * 70_000, t).name) < 250


def test_a_result_is_whole_or_not_there(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text("old")
    with pytest.raises(RuntimeError), atomic(path) as beside:
        beside.write_text("half of the n")
        raise RuntimeError
    assert [found.name for found in tmp_path.iterdir()] == ["result.json"] and path.read_text() == "old"


def test_what_a_killed_process_left_is_swept(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    (tmp_path / f".{_mark(ended.pid)}abc.json").write_text('{"half')
    (tmp_path / f".{_mark(os.getpid())}abc.json").write_text('{"in work')
    (tmp_path / ".hystid-00000000-1-abc.json").write_text("of another machine")
    _sweep.cache_clear()
    write_text(tmp_path / "result.json", "{}")
    assert len(list(tmp_path.iterdir())) == 3 and not list(tmp_path.glob(f".{_mark(ended.pid)}*"))


def test_results_print_on_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """Names of channels stand in results; those of a file of a logger can hold anything."""
    show("one \x1b[2J line\nand \u202eanother")
    assert capsys.readouterr().out == "one \\x1b[2J line\nand \\u202eanother\n"
