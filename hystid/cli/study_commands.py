"""``hystid study``: the same identification many times."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import typer

from hystid.cli import groups
from hystid.cli import options as opt
from hystid.cli.commands import app
from hystid.results import Result

T = TypeVar("T", bound=Result)
study = typer.Typer(
    rich_markup_mode=None,
    help="Many trainings: which structure, which mass. Resumable; on this machine or a Dask cluster.",
)
app.add_typer(study, name="study", no_args_is_help=True)


@study.command("grid")
@groups.grouped
def study_grid(*, settings: groups.Study, reading: groups.ReadingOptions) -> int:
    """Which network structure: 1-3 hidden layers of 2-13 neurons, many starts each, tested on held-out recordings.

    \b
    Examples:
      hystid study grid chirp*.csv --mass 4.2 --holdout sine20.csv --starts 30 -o grid
    """
    from hystid import study

    return 1 if _study(study.grid, settings, reading).failure else 0


@study.command("mass")
@groups.grouped
def study_mass(*, settings: groups.Study, reading: groups.ReadingOptions) -> None:
    """How much a mass that is weighed wrongly (-20 to +20 %) costs, for two hidden layers of each size.

    \b
    Examples:
      hystid study mass chirp*.csv --mass 4.2 --holdout sine20.csv -o mass
    """
    from hystid import study

    _study(study.mass, settings, reading)


def _study(kind: Callable[..., T], settings: groups.Study, reading: groups.ReadingOptions) -> T:
    unseen = opt.apart(settings.recordings, settings.holdout)
    with opt.resumable(settings.out):
        options = vars(settings) | {"recordings": reading.load(settings.recordings), "holdout": reading.load(unseen)}
        options["band"] = opt.band_of(settings.band)
        result = kind(**options)
        result.report(settings.out / "report.html", opt.command_line(f"study {kind.__name__}"))
    opt.done(result, settings.out)
    return result
