"""The one place that knows the front end: Modelica text in, ``FlatModel`` out.

rumoca parses, resolves inheritance, components and connections, and checks types, in a process of its own
(``worker.py``); its "flat" dictionary is turned into our own types here. Versions other than the pinned ones are
refused, because the dictionary has no contract.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

from hystid.errors import ModelicaError
from hystid.files import scratch, scratch_folder
from hystid.limits import COMPILE_SECONDS, OutOfTime, counted, wait_until_over
from hystid.modelica.adapter import Adapter
from hystid.modelica.annotations import description_of, experiment_of
from hystid.modelica.diagnostics import broken_down, explain, gave_up, located_syntax_error
from hystid.modelica.dictionary import ASKED_FOR
from hystid.modelica.flat import FlatModel
from hystid.modelica.sizes import deciding_words
from hystid.modelica.sources import Source, declaration, library_folder, read

_MEMORY = 8 << 30  # bytes
_STACK = 256 << 20  # bytes: parentheses nested ten thousand deep fit


def flatten(
    name: str,
    files: Sequence[Source],
    library: Sequence[tuple[Source, Path]],
    structure: Mapping[str, float | str],
) -> FlatModel:
    """The flat model of class ``name``.

    files: texts given by the user. library: texts of packages, each with its place, which need not be where its text
    comes from. structure: values of parameters that decide sizes or which equations exist.
    Raises ModelicaError with file and line.
    """
    texts = [source for source, _ in library]
    with _one_root(library) as root, FrontEnd(name, files, texts, root) as front_end:
        dictionary = front_end.flat_dictionary(structure)
    flat = Adapter(name, (*files, *texts)).model(dictionary, deciding_words(name, (*files, *texts)))
    declared = declaration(name, (*files, *texts))
    return replace(flat, description=description_of(declared), experiment=experiment_of(declared))


@contextmanager
def _one_root(library: Sequence[tuple[Source, Path]]) -> Iterator[Path]:
    """A folder that holds the packages: the front end takes one, and reads everything in it.

    Our library alone lies in such a folder; else the texts are written into one.
    """
    folder = library_folder()
    if all((path := folder / file).is_file() and source.text == read(path).text for source, file in library):
        yield folder
        return
    with scratch() as stage:
        for source, file in library:
            # the front end takes packages that are folders, and passes over one that is a file
            copy = stage / (file if len(file.parts) > 1 else Path(file.stem, "package.mo"))
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_text(source.text, encoding="utf-8")
        yield stage


class FrontEnd:
    """rumoca in a process of its own, asked about one class as often as wanted; a context manager.

    It keeps every file that it ever parsed in the user's cache folder, without end; here it gets a folder that goes
    away with it. Parsing the library anew costs some 30 ms.
    """

    def __init__(self, name: str, files: Sequence[Source], library: Sequence[Source], root: Path) -> None:
        _refuse_other_versions()
        self.name = name
        self.files = files
        self.library = library
        self._root = str(root)
        self._folder = scratch_folder()
        self._printed = tempfile.TemporaryFile()  # noqa: SIM115  # closed in __exit__, with the process
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("worker.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._printed,
            encoding="utf-8",
            env={**_environment(), "XDG_CACHE_HOME": str(self._folder), "PYTHONIOENCODING": "utf-8"},
            start_new_session=True,
        )
        self._counted = ExitStack()
        self._counted.enter_context(counted(self._process))
        # names of folders that do not exist: the front end would read what lies beside a real file
        self._named = {f"hystid-{number}/{source.path.name}": source for number, source in enumerate(files)}
        self._first = {
            "path": sys.path,
            "memory": _memory_limit(),
            "seconds": math.ceil(COMPILE_SECONDS.value),  # should nobody be there any more to end it
            "stack": _STACK,
            "root": str(root),
            "files": [[path, source.text] for path, source in self._named.items()],
            "library": [[str(source.path), source.text] for source in library],
        }

    def __enter__(self) -> FrontEnd:
        return self

    def __exit__(self, *_: object) -> None:
        self._counted.close()
        self._process.communicate()
        self._printed.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def flat_dictionary(self, structure: Mapping[str, float | str]) -> dict[str, Any]:
        """The front end's flat dictionary. Raises ModelicaError for its complaints, and where it does not answer."""
        wrapper = {"class": ASKED_FOR, "path": f"hystid/{ASKED_FOR}.mo", "text": _wrapper(self.name, structure)}
        answer: dict[str, Any] = json.loads(self._asked(wrapper))
        if "unbalanced model" in answer.get("error", "") and not self._has_streams():
            # it counts alone; of a partial class it counts nothing, and who reads the equations finds which are amiss
            uncounted = json.loads(self._asked({**wrapper, "text": f"partial {wrapper['text']}"}))
            answer = answer if uncounted.keys() & {"error", "breakdown"} else uncounted
        if "breakdown" in answer:
            raise broken_down(answer["breakdown"], self.name, (*self.files, *self.library))
        if "error" in answer:
            located_syntax_error(list(zip((*self.files, *self.library), answer["syntax"], strict=True)))
            message = answer["error"]
            for path, source in self._named.items():
                message = message.replace(path, str(source.path))
            message = message.replace(wrapper["path"], f"the values given to {self.name}")
            message = self._in_real_files(message)
            raise explain(message, self.name, self.files, self.library)
        return answer

    def _in_real_files(self, message: str) -> str:
        """The message with the user's files in place of their copies, which go away with the front end."""
        for copy in set(re.findall(rf"{re.escape(self._root)}[\\/]([^:*?\"<>|\n]+\.mo)", message)):
            inside = Path(copy).parts
            alone = (f"{inside[0]}.mo",) if inside[1:] == ("package.mo",) else inside  # a package that is a file
            ends = {inside, alone}
            real = (str(s.path) for s in self.library if {s.path.parts[-len(end) :] for end in ends} & ends)
            message = message.replace(str(Path(self._root, copy)), next(real, copy))
        return message

    def _has_streams(self) -> bool:
        return any(re.search(r"\bstream\b", s.plain) for s in (*self.files, *self.library))

    def _asked(self, wrapper: Mapping[str, str]) -> str:
        assert self._process.stdin and self._process.stdout
        try:
            for line in ([self._first] if self._first else []), [wrapper]:
                self._process.stdin.writelines(json.dumps(item) + "\n" for item in line)
            self._process.stdin.flush()
            self._first = {}
            answer = self._process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        if not answer.endswith("\n"):
            raise self._silent()
        return answer

    def _silent(self) -> ModelicaError:
        wait_until_over(self._process)
        self._counted.close()
        code = self._process.returncode
        self._printed.seek(0)
        printed = self._printed.read().decode(errors="replace")
        if code == -getattr(signal, "SIGXCPU", 0):
            raise OutOfTime  # the system's own clock may end it before the compilation's does
        if re.search("memory allocation|MemoryError", printed):
            how = "it ran out of memory"
        elif code == -signal.SIGSEGV:
            how = "something is nested too deeply"
        else:
            how = f"its process ended with code {code}"
        return gave_up(how, self.name, (*self.files, *self.library))


def _environment() -> dict[str, str]:
    """The environment without MODELICAPATH: the front end would read every file below it."""
    return {name: value for name, value in os.environ.items() if name != "MODELICAPATH"}


def _memory_limit() -> int:
    """Bytes of address space for the front end: it stays away from the last quarter of the machine's memory."""
    if not hasattr(os, "sysconf"):
        return _MEMORY
    return min(_MEMORY, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") * 3 // 4)


def _wrapper(name: str, structure: Mapping[str, float | str]) -> str:
    """A class that extends the wanted one, so that files, packages and structural values take one way in."""
    values = ", ".join(_modifier(key, value) for key, value in structure.items())
    return f"model {ASKED_FOR}\n  extends {name}{f'({values})' if values else ''};\nend {ASKED_FOR};\n"


def _modifier(name: str, value: float | str) -> str:
    """A modifier of a component's parameter stands in brackets: law.N is set by law(N = 4)."""
    if "[" in name:
        raise ModelicaError(f"'{name}' decides sizes or equations within an array: give its value in the Modelica text")
    *components, last = name.split(".")
    return "".join(f"{component}(" for component in components) + f"{last} = {_literal(value)}" + ")" * len(components)


def _literal(value: float | str) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return str(value).lower()
    return str(int(value)) if float(value).is_integer() else repr(float(value))


def _refuse_other_versions() -> None:
    try:
        found = sys.modules.get("rumoca", ...) is not None and metadata.version("rumoca")
    except metadata.PackageNotFoundError:
        found = False
    if not found:
        raise ModelicaError(
            "compiling Modelica text needs the front end 'rumoca': pip install 'rumoca>=0.10,<0.11' "
            "(models of the HystId library build without it)"
        )
    if not found.startswith("0.10."):
        raise ModelicaError(f"front end rumoca {found} is not supported: pip install 'rumoca>=0.10,<0.11'")
