"""What every answer of hystid can do: say itself in words, draw itself, and be written to a folder."""

from __future__ import annotations

import shutil
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

from hystid.files import write_json
from hystid.outputs import replaced

_CALLS = {  # by the module of the report: what a reader can run where no command line was given
    "diagnosis": "hystid.diagnose(...)", "examination": "hystid.check(...)", "identification": "hystid.identify(...)",
    "recording": "hystid.read(...)", "regression": "hystid.regress(...)", "study": "hystid.study",
    "validation": "hystid.validate(...)",
}  # fmt: skip


class Result:
    """Base of the answers of ``identify``, ``validate``, ``diagnose``, ``check``, ``study`` and ``regress``.

    A subclass names the module of ``hystid.report`` that shows it, and its JSON file:
    ``class Diagnosis(Result, report="diagnosis", json="diagnosis.json")``. The report is loaded by name when a result
    is shown, because results lie below reports and need none to be computed.
    """

    _report: ClassVar[str]
    _json: ClassVar[str]

    def __init_subclass__(cls, report: str = "", json: str = "", **rest: Any) -> None:
        super().__init_subclass__(**rest)
        if report:
            cls._report, cls._json = report, json

    def as_dict(self) -> dict[str, Any]:
        """Everything in plain Python types: the content of the JSON file."""
        raise TypeError(f"{type(self).__name__} has no JSON form")  # every subclass has its own

    def summary(self) -> str:
        """The answer in a few lines of plain text, as the command line prints it."""
        return str(_view(self).summary(self))

    def plots(self) -> tuple[str, ...]:
        """Titles of the figures that ``plot`` can draw, in the order of the report."""
        return tuple(plot.title for plot in _view(self).page(self, "").figures)

    def plot(self, title: str = "") -> Any:
        """A figure of the report as ``plotly.graph_objects.Figure``.

        title: a title of ``plots()`` or the beginning of one; "" gives the first. Raises UsageError for no such figure.
        """
        return import_module("hystid.report.plots").chosen(_view(self).page(self, "").figures, title)

    def save(self, folder: str | Path, command: str = "") -> Path:
        """Write all files of the result, with its JSON and ``report.html``, into a folder; returns the folder.

        An earlier result in the folder is replaced whole; other files there stay. command: shown in the report as the
        way to get the result again. Raises UsageError where the folder cannot be written.
        """
        with replaced(Path(folder)) as new:
            self._write(new)
            self.report(new / "report.html", command)
        return Path(folder)

    def report(self, path: str | Path, command: str = "") -> Path:
        """Write the report alone, one self-contained HTML file; returns its path. command: as for ``save``."""
        return Path(_view(self).page(self, command or _CALLS.get(self._report, "hystid")).write(Path(path)))

    def _write(self, folder: Path) -> None:
        """Files of the result but its report; by default those it was written to, else its JSON alone."""
        written: Path | None = getattr(self, "folder", None)
        if written is not None and written.is_dir():
            for file in written.iterdir():
                if file.is_file() and file.name != "report.html" and not file.name.startswith("."):
                    shutil.copy2(file, folder / file.name)
        write_json(folder / self._json, self.as_dict())

    def _repr_html_(self) -> str:
        """What a notebook shows: the headline and the figures that carry it."""
        return str(_view(self).page(self, "").card())


def _view(result: Result) -> Any:
    return import_module(f"hystid.report.{result._report}")
