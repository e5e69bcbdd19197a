"""``compile_model``: a class name or a file in, ``ModelCode`` out."""

from __future__ import annotations

import gc
import logging
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from hystid.errors import ModelicaError, listed
from hystid.limits import compiled
from hystid.modelcode import ModelCode
from hystid.modelica.absent import refuse_absent_classes, refuse_absent_imports, refuse_absent_model
from hystid.modelica.causalise import causalise
from hystid.modelica.check import check_units
from hystid.modelica.describe import model_code
from hystid.modelica.expand import elements
from hystid.modelica.flat import FlatModel, FlatVariable
from hystid.modelica.frontend import flatten
from hystid.modelica.library import library_sources, shipped
from hystid.modelica.lookup import Tree, cut, without_idle_imports
from hystid.modelica.random_numbers import seeds_of_names
from hystid.modelica.reach import only_class
from hystid.modelica.signatures import units_of_functions
from hystid.modelica.sizes import refuse_large_arrays, refuse_many_scalars, refuse_widened_arrays
from hystid.modelica.sources import Source, declaration, read, read_tree, search_path
from hystid.modelica.workarounds.calls_in_when import with_calls_in_algorithms
from hystid.modelica.workarounds.delay_times import with_real_delays
from hystid.modelica.workarounds.derivatives_in_loops import with_derivatives_in_branches
from hystid.modelica.workarounds.derivatives_of_expressions import with_named_derivatives
from hystid.modelica.workarounds.discrete_inputs import with_named_inputs
from hystid.modelica.workarounds.dropped_modifiers import (
    refuse_mixed_functions,
    refuse_undecided,
    with_acting_modifiers,
)
from hystid.modelica.workarounds.enumeration_numbers import with_numbers_of_enumerations
from hystid.modelica.workarounds.external_functions import with_plain_externals
from hystid.modelica.workarounds.function_bindings import with_counted_bindings
from hystid.modelica.workarounds.function_bodies import with_readable_functions
from hystid.modelica.workarounds.homotopy_arguments import with_arguments_in_place
from hystid.modelica.workarounds.limits import with_limits_kept
from hystid.modelica.workarounds.literal_arrays import with_elements_of_arrays
from hystid.modelica.workarounds.matrix_bodies import with_known_matrices
from hystid.modelica.workarounds.model_algorithms import with_carried_algorithms
from hystid.modelica.workarounds.namesakes import with_functions_apart
from hystid.modelica.workarounds.nested_bases import with_unwrapped_bases
from hystid.modelica.workarounds.nested_conditions import with_branches_side_by_side
from hystid.modelica.workarounds.package_constants import with_separate_packages
from hystid.modelica.workarounds.random_functions import with_known_starts
from hystid.modelica.workarounds.record_fields import with_named_fields
from hystid.modelica.workarounds.sample_conditions import with_plain_samples
from hystid.modelica.workarounds.shared_sources import with_separate_elements
from hystid.modelica.workarounds.surface_tables import with_known_surfaces
from hystid.modelica.workarounds.table_files import with_tables_of_files
from hystid.modelica.workarounds.values_of_elements import with_named_values

_log = logging.getLogger("hystid")
_LISTED_NAMES = 6  # names in one sentence

# Our small package of units, constants and functions of the Modelica Standard Library, for those who have none.
_STANDARD = Path(__file__).parent / "standard"


def compile_model(
    model: str, *, parameters: Mapping[str, float] | None = None, libraries: Sequence[Path] = ()
) -> ModelCode:
    """C for a Modelica model.

    model: a class of the library ("HystId.Oscillators.Jenkins") or of a file ("rig.mo:Rig", "f/package.mo:Rig.Arm");
    of a file with one model, its name may be left out ("rig.mo").
    parameters: name -> value; those that decide sizes or equations are built in, the others become start values.
    libraries: further .mo files, package folders, or folders that hold packages, as those that MODELICAPATH names.
    Raises ModelicaError with file, line, construct and the way around it.
    """
    return _deeply(model, lambda: _compiled(model, dict(parameters or {}), libraries))


def _compiled(model: str, values: dict[str, float], libraries: Sequence[Path]) -> ModelCode:
    flat = flat_model(model, libraries=libraries)
    structure: dict[str, float | str] = {}
    # a component that only such a value brings in may have others
    while given := [v for v in flat.variables if v.structural and v.name in values]:
        structure |= {v.name: _typed(v, values.pop(v.name)) for v in given}
        flat = flat_model(model, libraries=libraries, structure=structure)
    names = ", ".join(dict.fromkeys(seeds_of_names(flat)))
    if names:
        _log.warning(
            "%s: the seeds of this noise follow from the names %s, which tools write in different ways: others draw "
            "other numbers; useAutomaticLocalSeed = false with fixedLocalSeed gives all of them the same", model, names,
        )  # fmt: skip
    _tell_without_value(flat, values)
    return model_code(causalise(flat, values))


def _tell_without_value(flat: FlatModel, values: Mapping[str, float]) -> None:
    """A warning that names the parameters that neither the text nor ``values`` gives a value."""
    open_ones = [
        v for v in flat.variables if v.variability == "parameter" and v.binding is None and v.fixed is not False
    ]
    places = {name: v.place for v in open_ones for name in elements(v.name, v.dims) if name not in values}
    names = [*places]
    if names:
        _log.warning(
            "%s: no value is given to %s: the start value counts, 0 where none is stated",
            places[names[0]], listed(names, _LISTED_NAMES),
        )  # fmt: skip


def _deeply(model: str, work: Callable[[], ModelCode]) -> ModelCode:
    """The work with its limits of depth and time, as sentences."""
    try:
        with _without_collector():
            return compiled(model, work, ModelicaError)
    except RecursionError:
        raise ModelicaError(f"{model}: an expression is nested too deeply: name parts of it as variables") from None


@contextmanager
def _without_collector() -> Iterator[None]:
    """Python's search for unreachable circles would take a quarter of the time: a model's trees have none."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def flat_model(
    model: str, *, libraries: Sequence[Path] = (), structure: Mapping[str, float | str] | None = None
) -> FlatModel:
    """The flat model of ``model``, with values of structural parameters built in. Raises ModelicaError.

    The shipped one is taken for a class of the library, the front end is asked for everything else.
    """
    stored = None if libraries or structure else shipped(model)
    return stored or flat_from_text(model, libraries=libraries, structure=structure)


def flat_from_text(
    model: str, *, libraries: Sequence[Path] = (), structure: Mapping[str, float | str] | None = None
) -> FlatModel:
    """The flat model from Modelica text by the front end, checked. Raises ModelicaError."""
    name, files, placed = texts_for(model, libraries)
    files = [_unfolded(source) for source in files]
    placed = [(_unfolded(source), file) for source, file in placed]
    everything = [*files, *(source for source, _ in placed)]
    _must_be_complete(name, everything)
    numbers = {n: value for n, value in (structure or {}).items() if not isinstance(value, str)}
    refuse_large_arrays(name, everything, numbers)
    acting = with_acting_modifiers(name, with_limits_kept(name, with_separate_packages(name, everything)))
    acting = with_carried_algorithms([with_calls_in_algorithms(s) for s in with_named_inputs(name, acting)])
    acting = with_named_fields(with_named_values(with_separate_elements(with_functions_apart(acting))))
    acting = with_numbers_of_enumerations(acting)
    texts = with_counted_bindings(with_plain_samples([_in_words_that_it_takes(source) for source in acting]))
    places = [file for _, file in placed]
    flat = flatten(name, texts[: len(files)], list(zip(texts[len(files) :], places, strict=True)), structure or {})
    refuse_undecided(everything)
    refuse_mixed_functions(name, (f.name for f in flat.functions), everything)
    refuse_many_scalars(flat)
    refuse_widened_arrays(flat, everything)
    check_units(flat, units_of_functions(flat.functions, everything))
    return flat


def _unfolded(source: Source) -> Source:
    """Declarations as the passes over modifiers and the front end need them."""
    return with_branches_side_by_side(
        with_named_derivatives(with_unwrapped_bases(with_known_surfaces(with_tables_of_files(source))))
    )


def _in_words_that_it_takes(source: Source) -> Source:
    """Statements and equations, one after the other: each pass reads what the last one wrote."""
    for reworded in (
        with_known_matrices, with_plain_externals, with_readable_functions, with_elements_of_arrays,
        with_arguments_in_place, with_derivatives_in_branches, with_known_starts, with_real_delays,
    ):  # fmt: skip
        source = reworded(source)
    return source


def _must_be_complete(name: str, sources: Sequence[Source]) -> None:
    """A partial class is no model, and neither is a package or a function."""
    declared = declaration(name, sources)
    kind = declared.plain.split(maxsplit=1)[0] if declared is not None else ""
    if kind in ("package", "function", "connector", "record", "type"):
        raise ModelicaError(f"{declared}: '{name}' is a {kind}, not a model")
    if declared is not None and declared.plain.startswith("partial"):
        raise ModelicaError(f"{declared}: '{name}' is partial: compile a class that extends it")


def _typed(v: FlatVariable, value: float) -> float | str:
    """The value as the parameter's type: whole numbers, truth values, literals of enumerations, rarely Real."""
    if v.enumeration:
        items = dict(enumerate(v.enumeration.items, 1))
        if value not in items:
            said = ", ".join(f"{number} ({item})" for number, item in items.items())
            raise ModelicaError(f"{v.place}: parameter '{v.name}' cannot be {value:g}: it is one of {said}")
        return f"{v.enumeration.name}.{items[int(value)]}"
    if v.type == "Boolean":
        return bool(value)
    if v.type == "Integer" and value != int(value):
        raise ModelicaError(f"{v.place}: parameter '{v.name}' is an Integer and cannot be {value:g}")
    return int(value) if v.type == "Integer" else float(value)


def texts_for(model: str, libraries: Sequence[Path]) -> tuple[str, list[Source], list[tuple[Source, Path]]]:
    """Class name, the user's files, and the texts of packages with their places below the package's folder.

    Of HystId and of packages that the user names every text is there; of what MODELICAPATH and folders of packages
    hold, and of our small Modelica package, only what the class reaches. Raises ModelicaError where it is nowhere.
    """
    path, name = _split(model)
    files: list[Source] = []
    packages: list[Path] = []
    folders: list[Path] = []
    for entry in (*([path] if path else []), *map(Path, libraries)):
        kind, found = _kind_of(entry)
        if kind == "file":
            files.append(read(found))
        elif found not in (*packages, *folders):
            (packages if kind == "package" else folders).append(found)
    given = [(s, s.path.relative_to(p.parent)) for p in packages for s in read_tree(p)]
    given = [*given, *((s, s.path) for s in library_sources())]
    tree = Tree([*((s, s.path) for s in files), *given], [*folders, *search_path(), _STANDARD])
    refuse_absent_model(name, tree, files, [Path(entry) for entry in libraries])
    refuse_absent_classes(name, tree, files)
    reached = cut(tree, name, [*((s, s.path) for s in files), *given])
    refuse_absent_imports(tree)
    given = [(without_idle_imports(s, tree), place) for s, place in given]
    return name, [without_idle_imports(s, tree) for s in files], [*given, *reached]


_LONGEST_NAME = 200  # characters of a class or a file: file systems take 255 bytes


def _split(model: str) -> tuple[Path | None, str]:
    if any(len(part) > _LONGEST_NAME for part in re.split(r"[./\\:]", model)) or len(model) > 20 * _LONGEST_NAME:
        raise ModelicaError(f"'{model}' names no model: it is too long")
    found = re.fullmatch(r"(.+\.mo):([A-Za-z_][\w.]*)", model)
    if found:
        return Path(found.group(1)), found.group(2)
    if model.endswith(".mo") and Path(model).exists():
        return Path(model), only_class(Path(model))
    if Path(model).is_file() and not model.endswith(".mo"):
        told = f"{model}: a model is needed here, and a file of this kind, as recordings are, holds none"
        raise ModelicaError(f"{told}: write a class such as HystId.Oscillators.Jenkins, or file.mo:Class")
    if re.fullmatch(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", model) and not model.endswith(".mo"):
        return None, model
    if model.endswith(".mo"):
        raise ModelicaError(f"{model}: there is no such file")
    raise ModelicaError(f"'{model}' names no model: write a class such as HystId.Oscillators.Jenkins, or file.mo:Class")


def _kind_of(entry: Path) -> tuple[str, Path]:
    """A file of its own, the outermost folder of a package that the entry belongs to, or a folder of packages."""
    if not entry.exists():
        raise ModelicaError(f"{entry}: no such file")
    folder = entry.resolve() if entry.is_dir() else entry.resolve().parent
    if not (folder / "package.mo").is_file():
        if not entry.is_dir():
            return "file", entry
        if any(folder.glob("*/package.mo")) or any(folder.glob("*.mo")):
            return "folder", folder
        raise ModelicaError(f"{entry}: a folder without Modelica packages; name the .mo files")
    while (folder.parent / "package.mo").is_file():
        folder = folder.parent
    if folder.name.split()[0] == "Modelica":  # the standard library itself: only what is reached is read
        return "folder", folder.parent
    return "package", folder
