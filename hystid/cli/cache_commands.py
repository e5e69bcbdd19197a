"""``hystid cache``: what compiled models are kept, whether they are whole, and how to be rid of them."""

from __future__ import annotations

from typing import Annotated

import typer

from hystid.cli.commands import app
from hystid.errors import UsageError, printable

_ACTIONS = ("show", "verify", "clear")


@app.command(name="cache")
def show_cache(
    action: Annotated[
        str, typer.Argument(metavar="[show|verify|clear]", help="Show it, check every entry, or empty it.")
    ] = "show",
) -> None:
    """The cache of compiled models: where it is, whether it is whole, and how to empty it.

    Damaged entries are made anew where they are needed. HYSTID_CACHE names another folder.

    \b
    Examples:
      hystid cache
      hystid cache verify
      hystid cache clear
    """
    from hystid import cache

    if action not in _ACTIONS:
        raise UsageError(f"cache {action}: write {', '.join(_ACTIONS[:-1])} or {_ACTIONS[-1]}")
    if action == "clear":
        place, freed = cache.clear()
        print(f"{place}: emptied, {freed / 1e6:.1f} MB are free again")
        return
    found = cache.contents(verify=action == "verify")
    print(f"{found.folder}: {found.entries} entries, {found.size / 1e6:.1f} MB")
    if action == "verify":
        for name in found.damaged:
            print(f"{printable(name)}: damaged; it is made anew where it is needed")
        if found.damaged:
            raise typer.Exit(1)
        print("every entry is whole")
