"""Progress of long work: a bar on a terminal and in a notebook, silence elsewhere; and sentences that cannot wait."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from importlib import import_module
from typing import Any

Step = Callable[..., None]
_OFTEN = 0.2  # s between two drawings of a bar in a notebook: each is a message to the browser


@contextmanager
def track(title: str, total: int) -> Iterator[Step]:
    """Yield ``step(n=1, text="")``, to be called as work gets done; draws a bar with time left.

    total: number of steps. Nothing is drawn where standard error is neither a terminal nor a notebook's (logs stay
    readable).
    """
    if _in_notebook():
        with _notebook_bar(title, total) as step:
            yield step
    elif sys.stderr.isatty():
        with _terminal_bar(title, total) as step:
            yield step
    else:
        yield lambda n=1, text="": None


def tell(text: str) -> None:
    """Say a sentence on standard error now, as after Ctrl-C, when a result is still to come."""
    print(f"hystid: {text}", file=sys.stderr, flush=True)


@contextmanager
def quiet_models() -> Iterator[None]:
    """Keep the warnings of models back: of runs that no user asked for, there may be thousands."""
    logger = logging.getLogger("hystid")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def _in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    shell = sys.modules.get("IPython")
    running: Any = shell.get_ipython() if shell is not None else None
    return running is not None and "IPKernelApp" in running.config


@contextmanager
def _terminal_bar(title: str, total: int) -> Iterator[Step]:
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


@contextmanager
def _notebook_bar(title: str, total: int) -> Iterator[Step]:
    shell: Any = import_module("IPython.display")  # there is one where there is a notebook
    began, done, drawn, note = time.monotonic(), 0, 0.0, ""
    shown = shell.display(shell.HTML(_bar(title, 0, total, "")), display_id=True)

    def step(n: int = 1, text: str = "") -> None:
        nonlocal done, drawn, note
        done, note, now = done + n, text or note, time.monotonic()
        if now - drawn > _OFTEN:
            drawn = now
            left = (now - began) * (total - done) / done if done else 0.0
            shown.update(shell.HTML(_bar(title, done, total, f"{note} {left:.0f} s left".strip())))

    try:
        yield step
    finally:
        shown.update(shell.HTML(""))


def _bar(title: str, done: int, total: int, note: str) -> str:
    return f'{escape(title)} <progress value="{done}" max="{total}"></progress> {done} of {total} {escape(note)}'
