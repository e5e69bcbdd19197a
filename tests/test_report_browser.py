"""Reports in a real browser: figures are drawn, nothing is cut at any width, and every control does its work."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from browser import browser, look

from hystid.report.linked import Linked, Series
from hystid.report.page import Fact, Page, Table, Verdict
from hystid.report.plots import Axis, Bars, Heat, Line, Mark, Plot

pytestmark = pytest.mark.skipif(
    browser() is None and not os.environ.get("HYSTID_NEEDS_BROWSER"), reason="no Chromium is installed here"
)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    t = np.arange(6000) * 1e-3
    x, v = 1e-3 * np.sin(2 * np.pi * 4 * t), 8e-3 * np.pi * np.cos(2 * np.pi * 4 * t)
    forces = [
        Series("measured", 1e4 * x + 3 * np.sign(v), "measured", dots=True),
        Series("baseline", 1e4 * x, "before"),
    ]
    long = "a_very_long_name_of_a_recording_that_no_line_can_hold_" * 2
    page = Page("Diagnosis", verdict=Verdict("warn", f"Missing: {long}"), facts=[Fact(long, "1.234 mm", long)] * 4)
    page.toggles(("measured", "measured"), ("before", "baseline"))
    page.odds([("something is missing", 0.9, "warn"), ("nothing is missing", 0.1, "good")])
    page.section("One")
    page.linked(long, Linked.of((t, x, v), forces, [Series("baseline", np.sign(v), "before")]))
    heat = Heat(t[:4], t[:3], np.outer(np.arange(3.0), np.arange(4.0)), "force", "N")
    page.plots(
        Plot("Line", Axis("time", "s"), Axis("x", "m"), [Line(t, x, long, "before")], marks=[Mark(2.0, text="gap")]),
        Plot("Map", Axis("x", "m"), Axis("v", "m/s"), [heat]),
        Plot("Bars", Axis("case"), Axis("error", "%"), [Bars([long, "b"], np.array([1.0, 2.0]), "n", "measured")]),
    )
    page.table(Table("Wide", [f"column {k}" for k in range(12)], [["123456.7 kN"] * 12]))
    page.code("hystid " + 30 * "--option value ")
    page.reproduce("hystid diagnose " + 30 * "recording.csv ")
    return page.write(tmp_path_factory.mktemp("report") / "report.html")


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_cut(report: Path, tmp_path: Path, width: int) -> None:
    """No element reaches beyond the page, unless a box of its own scrolls it; every figure fills its box."""
    script = """
      var wide = document.documentElement.clientWidth, cut = [];
      document.querySelectorAll("body *").forEach(function (one) {
        if (one.closest(".scroll, pre, .plot")) { return; }
        if (one.getBoundingClientRect().right > wide + 1) { cut.push(one.tagName + "." + one.className); }
      });
      var plots = [].map.call(document.querySelectorAll(".plot"), function (one) {
        return [one.clientWidth, one.querySelector(".main-svg").getBoundingClientRect().width];
      });
      document.querySelectorAll(".scroll").forEach(function (one) {  // on a phone, wide tables are cards
        if (wide < 760 && one.scrollWidth > one.clientWidth + 1) { cut.push("scroll"); }
      });
      return { wide: wide, scroll: document.documentElement.scrollWidth, cut: cut, plots: plots };
    """
    found = look(report, script, tmp_path, width=width)
    assert found["cut"] == []
    assert found["scroll"] <= found["wide"]
    assert len(found["plots"]) == 7
    assert [pair for pair in found["plots"] if pair[0] <= 200 or abs(pair[0] - pair[1]) > 1] == []


@pytest.mark.parametrize("width", [390, 1280])
def test_powers_of_ten_leave_room_for_the_title(tmp_path: Path, width: int) -> None:
    f = np.geomspace(1.0, 500.0, 200)
    axes = (Axis("Frequency", "Hz", log=True), Axis("Power density", "1", log=True))
    page = Page("Spectra")
    page.plots(*(Plot(name, *axes, [Line(f, f**-4.0, name)]) for name in ("one", "two")))
    script = """
      return [].map.call(document.querySelectorAll(".plot"), function (plot) {
        var title = plot.querySelector(".ytitle").getBoundingClientRect();
        return Math.min.apply(null, [].map.call(plot.querySelectorAll(".ytick text"), function (label) {
          return label.getBoundingClientRect().left - title.right;
        }));
      });
    """
    gaps = look(page.write(tmp_path / "report.html"), script, tmp_path, width=width)
    assert len(gaps) == 2
    assert min(gaps) >= 1.0  # pixels


def test_the_cursor_the_slider_and_the_buttons(report: Path, tmp_path: Path) -> None:
    script = """
      var places = document.querySelectorAll(".linked .plot"), out = {};
      function last(place) { return place.data[place.data.length - 1]; }
      var loop = places[0], box = loop.getBoundingClientRect(), x = loop._fullLayout.xaxis, y = loop._fullLayout.yaxis;
      var at = { bubbles: true, view: window, clientX: box.left + x._offset + x.l2p(loop.data[0].x[7]),
                 clientY: box.top + y._offset + y.l2p(loop.data[0].y[7]) };
      ["mouseover", "mousemove"].forEach(function (kind) {
        loop.querySelector(".nsewdrag").dispatchEvent(new MouseEvent(kind, at));
      });
      await new Promise(function (done) { setTimeout(done, 300); });
      out.index = loop.data[0].x.indexOf(last(loop).x[0]);
      out.marked = [].map.call(places, function (place) {
        return last(place).x[0] === place.data[0].x[out.index] && last(place).y[0] === place.data[0].y[out.index];
      });
      var before = places[2].data[0].x[0], slider = document.querySelector(".slider input");
      slider.value = slider.value === "0" ? "1" : "0";
      slider.dispatchEvent(new Event("input"));
      await new Promise(function (done) { setTimeout(done, 300); });
      out.moved = places[2].data[0].x[0] - before;
      out.said = document.querySelector(".slider output").textContent;
      document.querySelector("button[data-role='@before']").click();
      await new Promise(function (done) { setTimeout(done, 300); });
      out.shown = [].map.call(document.querySelectorAll(".plot"), function (place) {
        return place.data.filter(function (one) { return one.visible === false; }).length;
      });
      return out;
    """
    found = look(report, script, tmp_path)
    assert found["marked"] == [True] * 4  # the same sample in all four views
    assert found["moved"] != 0 and found["said"].endswith(" s")
    # The baseline is hidden in the loop, both forces over time and the line; phase plane, map and bars have none.
    assert found["shown"] == [1, 0, 1, 1, 1, 0, 0]


def test_dark_ground_and_paper(report: Path, tmp_path: Path) -> None:
    script = """
      var place = document.querySelector(".plot");
      function seen() { return [place.layout.paper_bgcolor, place.data[0].marker.color]; }
      var screen = seen();
      window.dispatchEvent(new Event("beforeprint"));
      await new Promise(function (done) { setTimeout(done, 300); });
      var paper = seen();
      window.dispatchEvent(new Event("afterprint"));
      await new Promise(function (done) { setTimeout(done, 300); });
      return { screen: screen, paper: paper, again: seen() };
    """
    dark = look(report, script, tmp_path, options=("--blink-settings=preferredColorScheme=0",))
    light = look(report, script, tmp_path)
    assert dark["screen"] == dark["again"] != dark["paper"]
    assert dark["paper"] == light["screen"] == light["paper"] == ["#ffffff", "#2b3440"]


def test_tables_stay_tables_on_paper(report: Path, tmp_path: Path) -> None:
    """A sheet is narrower than many screens; cards are for phones."""
    script = """
      var rules = Array.from(document.styleSheets).flatMap(function (sheet) { return Array.from(sheet.cssRules); });
      return rules.filter(function (rule) { return rule.media && rule.cssText.includes(".stacked"); })
        .map(function (rule) { return rule.media.mediaText; });
    """
    assert look(report, script, tmp_path) == ["screen and (max-width: 760px)"]


def test_figures_are_whole_on_paper(report: Path, tmp_path: Path) -> None:
    """A sheet is narrower than the window: each figure is drawn for its column and keeps within it, and comes back."""
    script = """
      function svgs() { return Array.from(document.querySelectorAll(".plot .main-svg:first-child")); }
      var before = svgs().map(function (one) { return one.getBoundingClientRect().width; });
      window.dispatchEvent(new Event("beforeprint"));
      await new Promise(function (done) { setTimeout(done, 600); });
      var paper = document.createElement("style");  // the rules for paper, on the screen, on a sheet of A4
      paper.textContent = "body { width: 680px; }" + Array.from(document.styleSheets).flatMap(function (sheet) {
        return Array.from(sheet.cssRules);
      }).filter(function (rule) { return rule.media && rule.media.mediaText === "print"; }).flatMap(function (rule) {
        return Array.from(rule.cssRules).map(function (one) { return one.cssText; });
      }).join("\\n");
      document.head.appendChild(paper);
      var found = svgs().map(function (one) {
        var drawn = one.getBoundingClientRect(), box = one.closest(".plot").getBoundingClientRect();
        var scale = drawn.width / one.viewBox.baseVal.width;
        return [drawn.right - box.right, drawn.bottom - box.bottom, drawn.height, scale];
      });
      paper.remove();
      window.dispatchEvent(new Event("afterprint"));
      await new Promise(function (done) { setTimeout(done, 600); });
      var after = svgs().map(function (one) { return one.getBoundingClientRect().width; });
      return { before: before, after: after, found: found };
    """
    seen = look(report, script, tmp_path)
    assert len(seen["found"]) == 7
    for right, bottom, height, scale in seen["found"]:
        assert right <= 1 and bottom <= 1  # pixels
        assert height > 150 and 0.8 < scale < 1.25  # letters stay as large as the text beside them
    assert seen["after"] == pytest.approx(seen["before"], abs=1)
