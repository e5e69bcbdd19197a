"""Progress bars for long work: on a terminal only, silent elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Step = Callable[..., None]


@contextmanager
def track(title: str, total: int) -> Iterator[Step]:
    """Yield ``step(n=1, text="")``, to be called as work gets done; draws a bar with time left on a terminal.

    total: number of steps. Nothing is drawn where standard error is not a terminal (logs stay readable).
    """
    if not sys.stderr.isatty():
        yield lambda n=1, text="": None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(title, total=total, note="")

        def step(n: int = 1, text: str = "") -> None:
            bars.update(task, advance=n, note=text)

        yield step
