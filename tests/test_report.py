"""Report pages: escaped, deterministic, self-contained, small, with units on every axis and every peak kept."""

from __future__ import annotations

import base64
import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hystid.comparison import harmonics
from hystid.recording import Recording
from hystid.report.curves import (
    Curve,
    fundamental_of,
    harmonic_bars,
    highest_frequency,
    over_time,
    response,
    responses,
    spectra,
    window_of,
)
from hystid.report.linked import Linked, Series, windows
from hystid.report.page import Cell, Fact, Page, Table, Verdict, number, percent, with_error
from hystid.report.plots import (
    Axis,
    Band,
    Bars,
    Boxes,
    Heat,
    Line,
    Mark,
    Plot,
    Points,
    compact,
    figure,
    packed,
    prefix_for,
    thin,
)

T = np.linspace(0, 1, 500)
NASTY = '<script>alert("1")</script> & more'


def every_kind() -> Plot:
    series = [Line(T, np.sin(T), NASTY), Points(T[:3], T[:3], "p", labels=[NASTY] * 3), Band(T, T - 1, T + 1, "b")]
    return Plot(NASTY, Axis("Time t", "s"), Axis(NASTY, "N"), series, NASTY, [Mark(0.2, text="here"), Mark(0.5)])


def views(name: str, n: int = 5000) -> Linked:
    """Linked views of a sine, long enough for a slider."""
    t = np.arange(n) * 1e-3
    x, v = np.sin(2 * np.pi * 5 * t), np.cos(2 * np.pi * 5 * t)
    forces = [Series("measured", 2 * x + np.sign(v), "measured", dots=True), Series(name, 2 * x, "before")]
    return Linked.of((t, x, v), forces, [Series(name, np.sign(v), "before")])


def page() -> Page:
    made = Page(
        NASTY, subtitle=NASTY, command=NASTY, verdict=Verdict("good", NASTY, NASTY), facts=[Fact(NASTY, "1", NASTY)]
    )
    made.section(NASTY, NASTY)
    made.bullets([NASTY])
    made.code(NASTY)
    made.plots(every_kind(), Plot("bars", Axis("case"), Axis("error", "%"), [Bars([NASTY, "b"], np.array([1.0, 2]))]))
    made.linked(NASTY, views(NASTY))
    made.toggles(("measured", NASTY))
    made.odds([(NASTY, 0.9, "good"), ("rest", 0.1, "bad")])
    made.table(Table(NASTY, ["a", NASTY], [["1", Cell(NASTY, "bad")]], NASTY))
    made.reproduce(NASTY, {NASTY: NASTY})
    return made


VOID = {"meta", "link", "br", "img", "input"}


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.scripts = 0
        self.outside: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.scripts += tag == "script"
        self.outside += [
            value or "" for name, value in attrs if name in ("src", "href") and not (value or "").startswith("#")
        ]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open[-1] == tag, (tag, self.open)
        self.open.pop()


def test_all_text_is_escaped_and_the_page_is_well_formed() -> None:
    tags = Tags()
    tags.feed(page().html())
    assert tags.open == []
    # Two figures, one group of linked views, palettes, plotly, the drawing script: none of the texts became one.
    assert tags.scripts == 6


def test_a_page_needs_nothing_from_outside_and_is_the_same_every_time() -> None:
    text = page().html()
    tags = Tags()
    tags.feed(text)
    assert tags.outside == []
    assert text == page().html()
    own = re.sub(r"<script>.*?</script>", "", text, flags=re.S)
    assert "@import" not in own and "url(" not in own
    assert len(text) < 2.5e6  # plotly itself is 4.8 MB, compressed 2 MB


def test_a_page_without_figures_carries_no_plotting_library() -> None:
    made = Page("words")
    made.section("only", "text")
    assert len(made.html()) < 20_000


def test_axes_carry_quantity_and_unit_with_a_readable_prefix() -> None:
    plot = Plot("loop", Axis("Displacement x", "m"), Axis("Force", "N"), [Line(2e-3 * T, 3e4 * T, "")])
    layout = figure(plot)["layout"]
    assert layout["xaxis"]["title"]["text"] == "Displacement x [mm]"
    assert layout["yaxis"]["title"]["text"] == "Force [kN]"
    trace = figure(plot)["data"][0]
    assert trace["y"].max() == pytest.approx(30, rel=1e-6)


@pytest.mark.parametrize(
    ("largest", "unit", "expected"),
    [
        (0.5, "m", (1e-3, "mm")),
        (1e-6, "m", (1e-6, "µm")),
        (1500, "N", (1e3, "kN")),
        (3, "dB", (1, "dB")),
        (0, "m", (1, "m")),
    ],
)
def test_prefixes(largest: float, unit: str, expected: tuple[float, str]) -> None:
    assert prefix_for(largest, unit) == expected


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 60_000), st.integers(0, 2**32 - 1), st.booleans())
def test_thinning_keeps_every_peak_order_and_ends(n: int, seed: int, loop: bool) -> None:
    rng = np.random.default_rng(seed)
    y = rng.normal(size=n)
    x = rng.normal(size=n) if loop else np.arange(n, dtype=float)
    xs, ys = thin(x, y)
    assert xs.size <= 4100
    assert (ys.max(), ys.min(), ys[0], ys[-1]) == (y.max(), y.min(), y[0], y[-1])
    assert (xs.max(), xs.min()) == (x.max(), x.min())
    assert loop or np.all(np.diff(xs) > 0)


def test_a_million_samples_stay_small() -> None:
    t = np.arange(1_000_000) * 1e-4
    plot = over_time("long", Axis("x", "m"), [Curve("a", t, np.sin(t), "measured")], window=slice(500_000, 502_000))
    assert len(json.dumps(compact(plot))) < 200_000


def test_values_that_are_not_finite_leave_gaps_not_broken_json() -> None:
    heat = Heat(T[:3], T[:2], np.array([[1.0, np.nan, 2], [3, 4, 5]]), "force", "N")
    broken = T.copy()
    broken[5] = np.nan
    text = json.dumps(
        [
            compact(Plot("map", Axis("x", "m"), Axis("v", "m/s"), [heat])),
            compact(Plot("line", Axis("t", "s"), Axis("x", "m"), [Line(T, broken)])),
            compact(Plot("box", Axis("case"), Axis("e"), [Boxes(["a"], [np.array([1.0, math.inf])])])),
        ],
        allow_nan=False,
    )
    assert "null" in text


def test_numbers_read_well() -> None:
    assert percent(0.02134) == "2.1 %"
    assert number(4.2, "kg", 4) == "4.200 kg"
    assert number(2.3456e-9, "m") == "2.35 nm"
    assert number(2.3456e-9, "kg") == "2.35·10^-9 kg"
    assert number(50_000.0, "N/m") == "50.0 kN/m"
    assert number(0.25, "m") == "0.250 m"
    assert with_error(0.0011973, 5.1e-7, "m") == "1.19730 ± 0.00051 mm"
    assert with_error(0.8945, 0.00078, "1") == "0.89450 ± 0.00078"
    assert number(float("nan")) == number(None) == "not available"
    assert with_error(95.1089, 0.11, "kg") == "95.11 ± 0.11 kg"
    assert with_error(203.5034, 1.15, "N.s/m") == "203.5 ± 1.1 N.s/m"
    assert with_error(3.9991e8, 547295.0, "N/m3") == "(3.9991 ± 0.0055)·10^8 N/m3"
    assert with_error(0.00056, 0.041, "ms") == "0.001 ± 0.041 ms"  # no more decimals than the error
    assert with_error(514.0, 325.0, "mm/s") == "514 ± 325 mm/s"
    assert with_error(5.0, None) == "5.000"
    assert number(0.0) == "0"


def test_harmonic_tests_are_recognised_with_their_exact_frequency() -> None:
    t = np.arange(4000) * 1e-3
    assert fundamental_of(3 * np.sin(2 * np.pi * 19.87 * t), 1e-3) == pytest.approx(19.87, abs=1e-4)
    assert fundamental_of(np.random.default_rng(1).normal(size=4000), 1e-3) is None
    assert fundamental_of(np.sin(2 * np.pi * (5 * t + 10 * t**2)), 1e-3) is None


def test_windows_show_the_last_periods_or_the_largest_motion() -> None:
    t = np.arange(20_000) * 1e-3
    sine = np.sin(2 * np.pi * 20 * t)
    assert window_of(sine, sine, 1e-3) == slice(19_800, 20_000)
    burst = np.random.default_rng(2).normal(size=20_000) * np.exp(-(((t - 12) / 0.5) ** 2))
    near = window_of(burst, burst, 1e-3)
    assert near.start < 12_000 < near.stop


def test_spectra_and_harmonics_are_figures_with_units() -> None:
    t = np.arange(8000) * 1e-3
    y = np.sin(2 * np.pi * 10 * t) + 0.1 * np.sin(2 * np.pi * 30 * t)
    drawn = figure(harmonic_bars("h", [("a", "measured", harmonics(y, 1e-3, 10.0))]))
    assert drawn["data"][0]["x"] == [str(k) for k in range(2, 11)]
    third = drawn["data"][0]["y"][1] + drawn["data"][0]["base"]
    assert third == pytest.approx(-20, abs=1e-6)
    assert highest_frequency(y, 1e-3) == pytest.approx(100, abs=30)
    assert (
        "dB re 1 N²/Hz"
        in figure(spectra("s", "N", [Curve("a", t, y, "model")], 100))["layout"]["yaxis"]["title"]["text"]
    )


def test_writing_is_atomic(tmp_path: Path) -> None:
    target = page().write(tmp_path / "sub" / "report.html")
    assert target.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert [path.name for path in target.parent.iterdir()] == ["report.html"]


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-1e9, 1e9) | st.just(math.nan), max_size=50))
@example([0.0, 5e-324])
def test_packed_values_come_back_within_half_a_step_of_16_bits(values: list[float]) -> None:
    given_ = np.array(values, dtype=float)
    pack = packed(given_)
    levels = np.frombuffer(base64.b64decode(pack["q"]), dtype="<u2")
    assert np.array_equal(levels == 65535, np.isnan(given_))
    known, levels = given_[levels != 65535], levels[levels != 65535].astype(float)
    if pack.get("log"):
        known, back, step = np.log(known), np.log(pack["lo"]), np.log(pack["hi"] / pack["lo"]) / 65534
    else:
        back, step = pack["lo"], (pack["hi"] - pack["lo"]) / 65534
    least = 65534 * np.finfo(float).smallest_subnormal  # of a step that is below the smallest double
    rounding = 1e-12 * np.max(np.abs(known), initial=0.0) + least
    assert np.max(np.abs(back + step * levels - known), initial=0.0) <= 0.5 * step + rounding


def test_a_page_names_roles_and_leaves_colours_to_the_ground() -> None:
    text = json.dumps(compact(every_kind()))
    assert "@muted" in text and "#98a2ae" not in text


def test_windows_of_a_long_recording_hold_whole_loops_and_stay_small() -> None:
    t = np.arange(100_000) * 1e-4
    x = np.sin(2 * np.pi * 3 * t * t) * np.exp(-((t - 6) ** 2))
    parts, first = windows(x)
    assert len(parts) > 3
    for part in parts:
        assert 10 < len(range(*part.indices(x.size))) <= 301
        assert 0 <= part.start < part.stop <= x.size
    middle = parts[first]
    assert abs(t[middle.start] - 6) < 1.5  # where the motion is largest
    assert windows(x[:100]) == ([slice(0, 100, 1)], 0)


def test_the_frequency_response_of_a_linear_oscillator_is_its_receptance() -> None:
    """m = 1 kg, B = 20 N.s/m, Kl = 1e4 N/m under white noise; Welch leaves a few per cent of bias at the peak."""
    rng, dt = np.random.default_rng(3), 1e-3
    F = rng.normal(size=40_000)
    omega = 2 * np.pi * np.fft.rfftfreq(F.size, dt)
    x = np.fft.irfft(np.fft.rfft(F) / (1e4 - omega**2 + 20j * omega), F.size)
    frequency, gain = response(F, x, dt)
    near = (frequency > 2) & (frequency < 100)
    w = 2 * np.pi * frequency[near]
    assert gain[near] == pytest.approx(1 / np.abs(1e4 - w**2 + 20j * w), rel=0.15)
    records = [Recording(f"r{k}", dt * np.arange(F.size), F=k * F, x=k * x) for k in (1, 2)]
    shown = responses(records)
    assert shown is not None and len(shown.series) == 2


def test_small_values_of_a_spectrum_survive_the_packing() -> None:
    """Steps of the logarithm: ten decades in 65534 steps leave 4e-4 of each value."""
    values = np.geomspace(1e-12, 1e-2, 500)
    pack = packed(values)
    levels = np.frombuffer(base64.b64decode(pack["q"]), dtype="<u2")
    back = pack["lo"] * np.exp(np.log(pack["hi"] / pack["lo"]) / 65534 * levels)
    assert pack["log"]
    np.testing.assert_allclose(back, values, rtol=4e-4)
