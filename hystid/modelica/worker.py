"""The front end in a process of its own, run as a script by ``frontend.py``.

An abort, a hang or a lack of memory inside rumoca ends this process and not the user's.
One JSON line in with what all questions share, then one line per question: a class text in, one line with the flat
dictionary or with the complaint out. Nothing of hystid is imported here, so that a start costs some 50 ms.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Iterable
from typing import Any


def main() -> None:
    """Answers the questions on stdin until it ends."""
    questions = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115  # open as long as the process
    shared = json.loads(questions.readline())
    sys.path[:] = shared["path"]
    _limit(shared["memory"], shared["seconds"])
    threading.stack_size(shared["stack"])
    thread = threading.Thread(target=_answer_all, args=(shared, questions))
    thread.start()
    thread.join()


def _answer_all(shared: dict[str, Any], questions: Iterable[str]) -> None:
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what the front end prints is no answer
    for line in questions:
        answers.write(_answer(shared, json.loads(line)) + "\n")
        answers.flush()


def _limit(memory: int, seconds: int) -> None:
    """Bytes of address space, and seconds of computing; beyond them the system ends this process."""
    try:
        import resource
    except ImportError:  # not on Windows
        return
    for kind, limit in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, seconds)):
        _soft, hard = resource.getrlimit(kind)
        wanted = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        resource.setrlimit(kind, (wanted, hard))


def _answer(shared: dict[str, Any], wrapper: dict[str, str]) -> str:
    """JSON text: the flat dictionary, {"error": words, "syntax": diagnostics of each text}, or {"breakdown": words}."""
    import rumoca

    session = rumoca.Session(roots=[shared["root"]])
    try:
        for path, text in shared["files"]:
            _retain(rumoca, session, text, path, wrapper["class"])
        model = session.loads(wrapper["text"], model=wrapper["class"], filename=wrapper["path"])
        return str(model.to_json("flat", pretty=False))  # in one line, and in a third of the text
    except rumoca.RumocaError as error:
        texts = [*shared["files"], *shared["library"]]
        said = [[str(d) for d in rumoca.validate_source(text, filename=path)] for path, text in texts]
        return json.dumps({"error": str(error), "syntax": said})
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # what a breakdown inside the front end raises; it has no base
            raise
        return json.dumps({"breakdown": str(error)})


def _retain(rumoca: Any, session: Any, text: str, path: str, name: str) -> None:
    """Adds a file to the session. Compiling it is not wanted here; what is wrong with it shows at the final load."""
    try:
        session.loads(text, model=name, filename=path)
    except rumoca.RumocaError:
        return
    except BaseException as error:
        if type(error).__name__ != "PanicException":
            raise


if __name__ == "__main__":
    main()
