"""Command line: one sub-command, one library call; 0 fine, 1 finding or failure, 2 wrong usage, 130 interrupted."""

from hystid.cli.run import main

__all__ = ["main"]
