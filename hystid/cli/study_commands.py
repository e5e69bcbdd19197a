"""``hystid study``: the same identification many times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import typer

from hystid.cli import options as opt
from hystid.cli.commands import app
from hystid.results import Result

study = typer.Typer(
    rich_markup_mode=None,
    help="Many trainings: which structure, which mass. Resumable; on this machine or a Dask cluster.",
)
app.add_typer(study, name="study", no_args_is_help=True)


@study.command("grid")
@opt.grouped
def study_grid(
    recordings: opt.Recordings,
    mass: opt.Mass,
    out: opt.Folder,
    holdout: opt.Holdout = None,
    *,
    settings: opt.Study,
    reading: opt.Reading,
) -> None:
    """Which network structure: 1-3 hidden layers of 2-13 neurons, many starts each, tested on held-out recordings.

    \b
    Examples:
      hystid study grid chirp*.csv --mass 4.2 --holdout sine20.csv --starts 30 -o grid
    """
    from hystid import study

    _study(study.grid, recordings, mass, out, holdout, settings, reading)


@study.command("mass")
@opt.grouped
def study_mass(
    recordings: opt.Recordings,
    mass: opt.Mass,
    out: opt.Folder,
    holdout: opt.Holdout = None,
    *,
    settings: opt.Study,
    reading: opt.Reading,
) -> None:
    """How much a mass that is weighed wrongly (-20 to +20 %) costs, for two hidden layers of each size.

    \b
    Examples:
      hystid study mass chirp*.csv --mass 4.2 --holdout sine20.csv -o mass
    """
    from hystid import study

    _study(study.mass, recordings, mass, out, holdout, settings, reading)


def _study(
    kind: Callable[..., Result],
    recordings: Sequence[Path],
    mass: float,
    out: Path,
    holdout: Sequence[Path] | None,
    settings: opt.Study,
    reading: opt.Reading,
) -> None:
    from hystid.processing import parse_band

    unseen = opt.apart(recordings, holdout)
    with opt.resumable(out):
        used, held = reading.load(recordings), reading.load(unseen)
        options = vars(settings) | {"band": parse_band(settings.band) if settings.band is not None else None}
        result = kind(used, mass=mass, holdout=held, out=out, **options)
        result.report(out / "report.html", opt.command_line(f"study {kind.__name__}"))
    opt.done(result, out)
