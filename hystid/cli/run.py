"""Entry point: runs a command and turns every outcome into an exit code and, where there is one, a sentence."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from hystid.errors import HystidError, printable, reason, sentence

_INTERRUPTED = 130  # 128 + SIGINT, as shells report it
_NAMES = (errno.ENAMETOOLONG, errno.ELOOP)  # the name that a user gave is wrong, not the machine


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run ``hystid`` with the given arguments (those of the process by default) and exit."""
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: Sequence[str]) -> int:
    """Run ``hystid`` and return its exit code. Messages go to standard error, results to standard output.

    An error of hystid's own gives its sentence and its exit code. What is left is a defect of hystid: it is named in
    one line with exit code 1; with ``HYSTID_DEBUG=1`` in the environment its traceback is shown.
    """
    # Before numpy: matrices are small here, and threads of a BLAS would mostly wait, for each other and for other work
    # on the machine (ten times slower with six diagnoses on two cores).
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    import typer

    from hystid.cli import cache_commands, study_commands  # noqa: F401  (add their commands)
    from hystid.cli.commands import app

    try:
        outcome = app(spread(arguments) or ["--help"], prog_name="hystid", standalone_mode=False)
    except typer.Exit as stop:
        return _interrupted() if stop.exit_code == _INTERRUPTED else stop.exit_code
    except (typer.Abort, KeyboardInterrupt) as error:
        if isinstance(error.__cause__, EOFError):  # a file that ended early, which click takes for the end of the input
            return _defect(error.__cause__)
        return _interrupted()
    except HystidError as error:
        _say(str(error))
        return error.exit_code
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader has gone: nothing to tell it
        return 0
    except (OSError, MemoryError) as error:
        _say(_resource(error))
        return 2 if isinstance(error, OSError) and error.errno in _NAMES else 1
    except Exception as error:
        if hasattr(error, "format_message"):  # typer's own: its class has another home from version to version
            return _misused(error)
        return _defect(error)
    if outcome == _INTERRUPTED:  # some versions of typer return what they make of Ctrl-C
        return _interrupted()
    return outcome if isinstance(outcome, int) else 0


def _interrupted() -> int:
    _say("interrupted: earlier files are kept as they were, and no file was left half written")
    return _INTERRUPTED


def _defect(error: BaseException) -> int:
    if os.environ.get("HYSTID_DEBUG"):
        raise error
    _say(f"internal error ({type(error).__name__}: {error}); set HYSTID_DEBUG=1 to see where, and please report it")
    return 1


def _misused(error: Any) -> int:
    """An option or argument that the command line does not know: the sentence, and where help is."""
    context = getattr(error, "ctx", None)
    if not error.format_message() or type(error).__name__ == "NoArgsIsHelpError":
        print(context.get_help() if context else error.format_message())
        return 2
    path = context.command_path if context else "hystid"
    _say(f"{error.format_message().rstrip('.')}; see '{path} --help'")
    return int(error.exit_code)


def _resource(error: OSError | MemoryError) -> str:
    if isinstance(error, MemoryError):
        return "there is not enough memory for this; use a larger --decimate or fewer recordings"
    where = f"{sentence(str(error.filename))}: " if error.filename else ""
    return f"{where}{reason(error)}"


def _say(text: str) -> None:
    for line in text.split("\n"):
        print(f"hystid: {printable(line)}", file=sys.stderr)


_FLAGS = {"--resample", "--update", "--strict", "--help", "-h", "--version"}


def spread(arguments: Sequence[str]) -> list[str]:
    """Let an option that may be repeated take several values in a row: ``--set a=1 b=2``, ``--holdout x.csv y.csv``.

    A value belongs to the option when it cannot be anything else: it holds "=", ends in .mo or is a force
    specification; for ``--holdout``, when the recordings to use have been named before.
    """
    spread_out: list[str] = []
    option, before = "", 0
    for argument in arguments:
        if argument.startswith("-") and len(argument) > 1 and not argument[1].isdigit():
            option = argument
        elif spread_out and spread_out[-1] == option and option not in _FLAGS:
            pass  # the first value of an option
        elif option and _belongs(option, argument, before):
            spread_out.append(option)
        else:
            option, before = "", before + 1
        spread_out.append(argument)
    return spread_out


def _belongs(option: str, value: str, positional: int) -> bool:
    from hystid.excitation import is_specification

    if option in ("--set", "--sensitivity", "--channel", "--unit"):
        return "=" in value
    if option == "--effects":
        return value.endswith(".mo")
    if option == "--force":
        return is_specification(value)
    return option == "--holdout" and positional > 1  # the command's name is the first
