"""Building blocks of a report: one HTML file with everything inside, readable without the documentation.

    page = Page(
        "Validation of the surrogate", command="hystid validate surrogate.fmu --against ref.fmu ...",
        verdict=Verdict("good", "The surrogate follows the reference: 2.1 % force error in the median"),
        facts=[Fact("Force error, median", percent(0.021), "of 8 harmonic tests")],
    )
    page.section("Loops", "Restoring force over displacement. The area of a loop is the energy of one cycle.")
    page.plots(Plot(...), Plot(...))          # two beside each other, below each other on a phone
    page.table(Table("Errors", ["test", "force NRMSE [-]"], [["20 Hz", number(0.02)]]))
    page.reproduce("hystid validate ...", {"seed": "1"})
    page.write(path)

Rules: first the verdict, then the figures that carry it, then the details. All text is escaped. The same calls give
the same bytes: no date, no random identifier. Plots are thinned (``plots.thin``), so that a page stays below 15 MB.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Literal

from hystid.files import write_text
from hystid.report.linked import Linked
from hystid.report.plots import COLOURS, DARK, Plot, Role, compact, prefix_for, turned_plot
from hystid.rotation import turned_text

_UNIT = re.compile(r"(?<=\d) (?=(?:%|\S{1,5}$))")  # a unit stays with its number
_BESIDE = 3  # columns that fit beside each other on a phone
_NEXT_TO_NOTHING = 5e-4  # probability that 0.1 % would overstate
Tone = Literal["good", "warn", "bad", "neutral"]


@dataclass(frozen=True)
class Verdict:
    """The one sentence that matters, its colour, and what stands behind it."""

    tone: Tone
    headline: str
    detail: str = ""


@dataclass(frozen=True)
class Fact:
    """A figure of the first screen: what it is, its value with unit, how to read it."""

    label: str
    value: str
    hint: str = ""


@dataclass(frozen=True)
class Cell:
    """A table cell with a colour that means something."""

    text: str
    tone: Tone = "neutral"


@dataclass(frozen=True)
class Table:
    """Rows of text; numbers come formatted (``number``, ``percent``). A cell with letters is set to the left."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str | Cell]]
    note: str = ""


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Rows of text in columns: the first to the left, the others to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [cell.ljust(w) if k < 1 else cell.rjust(w) for k, (cell, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def training_range(ranges: Mapping[str, tuple[float, float]], units: Mapping[str, str]) -> Table:
    """Least and greatest value of the signals that a model was trained on. units: of those that are not x, v and R."""
    known = {"x": "m", "v": "m/s", "R": "N", **units}
    rows = [[name, *(number(end, known.get(name, ""), 4) for end in ends)] for name, ends in ranges.items()]
    return Table("Training range", ["signal", "lowest", "highest"], rows)


def number(value: float | None, unit: str = "", digits: int = 3) -> str:
    """``digits`` significant digits with the unit, in mm or kN where that reads better.

    "not available" for None and NaN.
    """
    if value is None or not math.isfinite(value):
        return "not available"
    scale, shown = _prefixed(value, unit)
    return f"{_significant(value / scale, digits)} {shown}".strip()


def _prefixed(value: float, unit: str) -> tuple[float, str]:
    """Prefix only where the plain number reads badly: 0.5 m stays, 0.0012 m becomes 1.2 mm."""
    if value == 0 or 0.1 <= abs(value) < 1e4:
        return 1.0, "" if unit == "1" else unit
    scale, shown = prefix_for(abs(value), unit)
    return scale, "" if shown == "1" else shown


def percent(fraction: float | None, digits: int = 2) -> str:
    """A fraction in percent with ``digits`` significant digits."""
    if fraction is None or not math.isfinite(fraction):
        return "not available"
    return f"{_significant(100 * fraction, digits)} %"


def with_error(value: float, stderr: float | None, unit: str = "") -> str:
    """``value ± stderr unit`` with the digits that the standard error leaves meaning to."""
    if stderr is None or not math.isfinite(stderr) or stderr <= 0:
        return number(value, unit, 4)
    scale, shown = _prefixed(value, unit)
    value, stderr = value / scale, stderr / scale
    place = 1 - math.floor(math.log10(stderr))
    magnitude = math.floor(math.log10(max(abs(value), stderr)))
    if -5 < magnitude < 5 and place < 10:
        places = max(place, 0)
        return f"{value:.{places}f} ± {stderr:.{places}f} {shown}".strip()
    places, power = min(place + magnitude, 9), 10.0**magnitude
    return f"({value / power:.{places}f} ± {stderr / power:.{places}f})·10^{magnitude} {shown}".strip()


def graded(value: float, good: float, fair: float) -> Tone:
    """The colour of an error, by the greatest that is good and the greatest that is of use."""
    return "good" if value <= good else "warn" if value <= fair else "bad"


def _significant(value: float, digits: int) -> str:
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if -4 <= exponent < 7:
        return f"{value:.{max(digits - 1 - exponent, 0)}f}"
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}·10^{int(power)}"


class Page:
    """Collects the parts of a report in reading order; ``html`` joins them."""

    def __init__(
        self,
        title: str,
        *,
        subtitle: str = "",
        command: str = "hystid",
        verdict: Verdict | None = None,
        facts: Sequence[Fact] = (),
        rotational: bool = False,
    ) -> None:
        self._rotational = rotational
        title, subtitle = self._said(title), self._said(subtitle)
        verdict = self._said_verdict(verdict) if verdict else None
        facts = [Fact(self._said(fact.label), self._said(fact.value), self._said(fact.hint)) for fact in facts]
        self.title = title
        self.figures: list[Plot] = []
        self._toggles: list[tuple[Role, str]] = []
        self._card = f"<strong>{escape(verdict.headline)}</strong>" if verdict else f"<strong>{escape(title)}</strong>"
        self._card += "".join(
            f"<br>{escape(fact.label)}: <b>{escape(fact.value)}</b>{f' ({escape(fact.hint)})' if fact.hint else ''}"
            for fact in facts
        )
        self._body: list[str] = []
        self._sections: list[str] = []
        words = " ".join(f"<span>{escape(word)}</span>" for word in command.split())  # no line ends within an option
        self._head = [f'<p class="kicker">{words}</p>', f"<h1>{escape(title)}</h1>"]
        if subtitle:
            self._head.append(f'<p class="subtitle">{escape(subtitle)}</p>')
        if verdict:
            self._head.append(_verdict(verdict))
        if facts:
            self._head.append(_facts(facts))

    def _said(self, text: str) -> str:
        """A text of angle and torque where the rig turns."""
        return turned_text(text) if self._rotational else text

    def _said_verdict(self, verdict: Verdict) -> Verdict:
        return Verdict(verdict.tone, self._said(verdict.headline), self._said(verdict.detail))

    def section(self, title: str, text: str = "") -> None:
        """Start a section; it appears in the list of contents. Blank lines in text part paragraphs."""
        title = self._said(title)
        self._sections.append(title)
        self._body.append(f'<h2 id="s{len(self._sections)}">{escape(title)}</h2>')
        if text:
            self.text(text)

    def text(self, text: str) -> None:
        """Paragraphs, parted by blank lines."""
        self._body += [f"<p>{escape(part.strip())}</p>" for part in self._said(text).split("\n\n") if part.strip()]

    def bullets(self, items: Iterable[str]) -> None:
        """A list of sentences."""
        self._body.append("<ul>" + "".join(f"<li>{escape(self._said(item))}</li>" for item in items) + "</ul>")

    def links(self, items: Iterable[tuple[str, str]]) -> None:
        """Files beside this page: (relative path, what is in it)."""
        listed = "".join(
            f'<li><a href="{escape(path)}">{escape(path)}</a>: {escape(self._said(what))}</li>' for path, what in items
        )
        self._body.append(f"<ul>{listed}</ul>")

    def code(self, text: str) -> None:
        """Program text or a command, as it stands."""
        self._body.append(f"<pre>{escape(text.strip())}</pre>")

    def verdict(self, verdict: Verdict) -> None:
        """A coloured sentence within the page."""
        self._body.append(_verdict(self._said_verdict(verdict)))

    def plots(self, *plots: Plot, columns: int = 2) -> None:
        """Figures beside each other, one or two (``columns``) in a row; below each other on a narrow screen."""
        plots = tuple(map(turned_plot, plots)) if self._rotational else plots
        self.figures += plots
        kind = "grid one" if columns == 1 or len(plots) == 1 else "grid"
        self._body.append(f'<div class="{kind}">' + "".join(map(_plot, plots)) + "</div>")

    def linked(self, title: str, linked: Linked) -> None:
        """Views of the same samples with one cursor, and a slider through the windows of a long recording."""
        title = self._said(title)
        linked = linked.turned() if self._rotational else linked
        self.figures += linked.plots()
        self._body.append(_linked(title, linked))

    def odds(self, parts: Sequence[tuple[str, float, Tone]]) -> None:
        """Probabilities that add up to 1 as one bar, each with its name and colour; part of the first screen."""
        self._head.append(_odds(parts))

    def toggles(self, *shown: tuple[Role, str]) -> None:
        """Buttons that hide and show all curves of a role in every figure."""
        self._toggles = list(shown)

    def table(self, table: Table) -> None:
        """A table; on a narrow screen the rows of one with many columns become cards."""
        rows = [[self._said_cell(cell) for cell in row] for row in table.rows]
        titles = [self._said(name) for name in table.columns]
        self._body.append(_table(Table(self._said(table.title), titles, rows, self._said(table.note))))

    def _said_cell(self, cell: str | Cell) -> str | Cell:
        return Cell(self._said(cell.text), cell.tone) if isinstance(cell, Cell) else self._said(cell)

    def reproduce(self, command: str, settings: Mapping[str, str] | None = None) -> None:
        """The last section: the command, what it was given, and the versions that matter."""
        self.section("How to get these results again")
        rows = {**(settings or {}), "Versions": versions()}
        listed = "".join(f"<dt>{escape(key)}</dt><dd>{escape(value)}</dd>" for key, value in rows.items())
        self._body.append(f'<div class="box"><pre>{escape(command)}</pre><dl>{listed}</dl></div>')

    def card(self) -> str:
        """Headline and figures as a piece of HTML for a notebook, without styles or scripts."""
        return f"<div>{self._card}</div>"

    def html(self) -> str:
        """The whole page."""
        links = "".join(f'<a href="#s{k}">{escape(name)}</a>' for k, name in enumerate(self._sections, start=1))
        contents = f"<nav aria-label='Contents'>{links}</nav>" if len(self._sections) > 2 else ""
        buttons = "".join(
            f'<button type="button" aria-pressed="true" data-role="@{role}"><i style="--swatch:var(--{role})"></i>'
            f"{escape(name)}</button>"
            for role, name in self._toggles
        )
        tools = f'<div class="tools" role="group" aria-label="Curves shown">Show {buttons}</div>' if buttons else ""
        body = "\n".join(self._body)
        drawing = ""
        if 'class="figure"' in body or 'class="linked-data"' in body:
            palettes = json.dumps({"light": COLOURS, "dark": DARK}, separators=(",", ":"))
            drawing = (
                f'<script type="application/json" id="palettes">{palettes}</script>'
                f'<script type="application/gzip" id="plotly">{_plotly()}</script>\n'
                f"<script>{_asset('page.js')}</script>"
            )
        return (
            '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self.title)}</title>\n<style>{_colours()}{_asset('page.css')}</style></head>\n"
            f"<body><main><header>{''.join(self._head)}{contents}</header>\n{tools}{body}\n"
            "<footer>Made by hystid. All quantities in SI units unless the axis says otherwise. NRMSE is the rms of the"
            " error over the standard deviation of the reference.</footer></main>\n"
            f"{drawing}</body></html>\n"
        )

    def write(self, path: Path) -> Path:
        """Write the page atomically and return its path."""
        write_text(Path(path), self.html())
        return Path(path)


def versions() -> str:
    """hystid and the packages that decide numbers, with their versions."""
    return ", ".join(f"{name} {_version(name)}" for name in ("hystid", "numpy", "scipy"))


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # run from a source tree that was never installed
        return "of unknown version"


def _verdict(verdict: Verdict) -> str:
    detail = f"<p>{escape(verdict.detail)}</p>" if verdict.detail else ""
    return f'<div class="verdict {verdict.tone}"><strong>{escape(verdict.headline)}</strong>{detail}</div>'


def _facts(facts: Sequence[Fact]) -> str:
    cards = []
    for fact in facts:
        hint = f"<small>{escape(fact.hint)}</small>" if fact.hint else ""
        value = escape(fact.value).replace(" %", "&nbsp;%")  # a card is narrow
        cards.append(f'<div class="fact"><dt>{escape(fact.label)}</dt><dd>{value}{hint}</dd></div>')
    return f'<dl class="facts">{"".join(cards)}</dl>'


def _plot(plot: Plot) -> str:
    data = json.dumps(compact(plot), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    caption = f"<figcaption>{escape(plot.caption)}</figcaption>" if plot.caption else ""
    label = escape(f"{plot.title}. {plot.caption}", quote=True)
    return (
        f'<figure><h3>{escape(plot.title)}</h3><div class="plot" role="img" aria-label="{label}"'
        f' style="min-height:{min(plot.height, 320)}px"></div>'
        f'<script type="application/json" class="figure">{data}</script>{caption}</figure>'
    )


def _linked(title: str, linked: Linked) -> str:
    data = json.dumps(linked.data(), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    figures = "".join(
        f'<figure><h3>{escape(view.title)}</h3><div class="plot" role="img" aria-label="{escape(view.title)}"'
        ' style="min-height:300px"></div></figure>'
        for view in linked.views
    )
    last = len(linked.windows) - 1
    slider = ""
    if last > 0:
        slider = (
            f'<label class="slider">Time <input type="range" min="0" max="{last}" value="{linked.first}">'
            f" <output>{escape(linked.data()['spans'][linked.first])}</output></label>"
        )
    return (
        f'<div class="linked"><h3>{escape(title)}</h3>{slider}<div class="grid">{figures}</div>'
        f'<script type="application/json" class="linked-data">{data}</script></div>'
    )


def _odds(parts: Sequence[tuple[str, float, Tone]]) -> str:
    bars = "".join(f'<span class="{tone}" style="flex-grow:{max(share, 0.0):.4f}"></span>' for _, share, tone in parts)
    names = "".join(
        f'<li class="{tone}"><i></i>{escape(name)} <b>{_chance(share)}</b></li>' for name, share, tone in parts
    )
    return f'<div class="odds"><div aria-hidden="true">{bars}</div><ul>{names}</ul></div>'


def _chance(probability: float) -> str:
    """A probability as people say it: digits of what is next to nothing say nothing."""
    return "below 0.1 %" if 0 < probability < _NEXT_TO_NOTHING else percent(probability)


def _table(table: Table) -> str:
    wordy = [any(_is_text(row[k]) for row in table.rows) for k in range(len(table.columns))]
    head = "".join(
        f'<th scope="col"{_class("text" if text else "")}>{escape(name)}</th>'
        for name, text in zip(table.columns, wordy, strict=True)
    )
    rows = "".join("<tr>" + "".join(map(_cell, row, wordy, table.columns)) + "</tr>" for row in table.rows)
    stacked = _class("stacked" if len(table.columns) > _BESIDE else "")
    note = f'<p class="note">{escape(table.note)}</p>' if table.note else ""
    return (
        f'<div class="scroll"><table{stacked}><caption>{escape(table.title)}</caption>'
        f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>{note}</div>"
    )


def _cell(cell: str | Cell, text: bool, column: str) -> str:
    content, tone = (cell.text, cell.tone) if isinstance(cell, Cell) else (cell, "neutral")
    kind = " ".join(part for part in ("text" if text else "", tone if tone != "neutral" else "") if part)
    label = f' data-label="{escape(column)}"' if column else ""
    content = _UNIT.sub("\u00a0", escape(content))
    return f"<td{_class(kind)}{label}><span>{content}</span></td>"


def _class(name: str) -> str:
    return f' class="{name}"' if name else ""


def _is_text(cell: str | Cell) -> bool:
    content = cell.text if isinstance(cell, Cell) else cell
    return content != "not available" and sum(letter.isalpha() for letter in content) > 8


@cache
def _asset(name: str) -> str:
    return (files("hystid.report") / name).read_text(encoding="utf-8")


@cache
def _plotly() -> str:
    """The plotting library, compressed: 2 MB instead of 4.8; browsers of 2023 and later can inflate it."""
    from plotly.offline import get_plotlyjs

    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), 9, mtime=0)).decode("ascii")


def _colours() -> str:
    """The roles as CSS variables, for both grounds."""
    light, dark = (";".join(f"--{role}:{colour}" for role, colour in which.items()) for which in (COLOURS, DARK))
    return f":root{{{light}}}@media screen and (prefers-color-scheme: dark){{:root{{{dark}}}}}\n"
