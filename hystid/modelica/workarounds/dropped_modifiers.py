"""Modifiers that the front end reads and then drops without a word: rewritten so that they act, or refused.

Seen in rumoca 0.10. Rewritten: value and attributes of one element together, modifiers of a class redeclaration, and
modifiers of a constraining clause. Refused with a way around: what no rewriting saves. A wrong number is worse than a
refusal. Only classes that the model may depend on count; lines of the text stay where they are.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import count

from hystid.errors import ModelicaError
from hystid.modelica.clauses import Clause, Modifier, Modifiers, clauses
from hystid.modelica.reach import KEYWORD, Class, classes, reached
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited
from hystid.modelica.workarounds.joined_modifiers import Key, forgotten, key

_SUSPECT = re.compile(r"\b(?:redeclare|constrainedby)\b|\)\s*=(?!=)")
_FREE_NAME = re.compile(r"(?<![\w.])([A-Za-z_]\w*)(?:\s*\.\s*\w+)*(?!\s*[\w(=.])(?!\s*\()")
_BUILT_IN = frozenset(("true", "false", "and", "or", "not", "if", "then", "else", "elseif", "each", "final"))


def with_acting_modifiers(name: str, sources: Sequence[Source]) -> list[Source]:
    """The texts with every modifier that class ``name`` may meet written so that it acts.

    Raises ModelicaError, with file and line, for one that cannot be.
    """
    used = reached(name, sources)
    declared = [c for found in used.values() for owner in found or () for c in clauses(owner)]
    _refuse_extending_redeclarations([c for found in used.values() for c in found or ()])
    _refuse(declared, [s.plain for s in sources])
    lost = forgotten(declared)
    _refuse_moved_variables(declared, lost, [s.plain for s in sources])
    kinds = {c.name: c.kind for found in used.values() for c in found or ()}
    return [_rewritten(s, {_path(c) for c in used[s] or ()}, lost, kinds) for s in sources]


def refuse_undecided(sources: Sequence[Source]) -> None:
    """Raise ModelicaError for a text that the front end took but whose classes could not be told apart here."""
    for source in sources:
        found = _SUSPECT.search(source.plain) if classes(source) is None else None
        if found:
            raise ModelicaError(
                f"{source.place(found.start())}: modifiers in a file whose classes cannot be told apart are not "
                "supported: name classes without quotes, one 'end Name;' for each"
            )


def refuse_mixed_functions(name: str, functions: Iterable[str], sources: Sequence[Source]) -> None:
    """Raise ModelicaError where a function of a replaceable package is there in two forms.

    The front end gives the default package's function the body of the redeclared one.
    """
    names = list(functions)
    for found in reached(name, sources).values():
        for clause in (c for owner in found or () for c in clauses(owner)):
            if clause.owner.kind != "package" or "replaceable" not in clause.prefixes:
                continue
            for function in (n for n in names if clause.name in n.split(".")[:-1]):
                short = function.rsplit(".", 1)[-1]
                if any(n != function and n.rsplit(".", 1)[-1] == short for n in names):
                    raise ModelicaError(
                        f"{clause.owner.source.place(clause.start)}: function '{short}' of the replaceable package "
                        f"'{clause.name}' in two forms at once is not supported: make the function replaceable, "
                        f"'replaceable function {short} = ...', and redeclare that"
                    )


def _path(c: Class) -> tuple[str, ...]:
    return tuple(a.name for a in c.around())


# -- what is refused


def _refuse(declared: Sequence[Clause], texts: Sequence[str]) -> None:
    again = _redeclared(declared)
    for clause in declared:
        for offset, message in sorted(_problems(clause, again, texts)):
            raise ModelicaError(f"{clause.owner.source.place(offset)}: {message}")


def _refuse_moved_variables(
    declared: Sequence[Clause], lost: Mapping[Key, Mapping[str, str]], texts: Sequence[str]
) -> None:
    """What moves into a class must be constant there."""
    for clause in declared:
        for name, text in lost.get(key(clause), {}).items():
            for found in _FREE_NAME.finditer(text, text.find("=") + 1):
                word = found.group(1)
                if word not in _BUILT_IN and not _is_constant(word, texts):
                    raise ModelicaError(
                        f"{clause.owner.source.place(clause.start)}: '{word}' in the modifiers of "
                        f"'{clause.name}.{name}', which an extends clause modifies again, is not supported: give all "
                        "modifiers of it in one place"
                    )


def _refuse_extending_redeclarations(found: Iterable[Class]) -> None:
    for c in found:
        if re.match(rf"{KEYWORD}\s+extends\b", c.source.plain[c.start : c.body]):
            raise ModelicaError(
                f"{c.source.place(c.start)}: 'redeclare {c.kind} extends {c.name}' is not supported: declare a class "
                f"that extends the one behind '{c.name}' and redeclare with it"
            )


def _redeclared(declared: Iterable[Clause]) -> set[str]:
    """Names of all components and classes that are redeclared anywhere."""
    names = {c.name for c in declared if "redeclare" in c.prefixes}
    for clause in declared:
        names.update(m.name for m, _, _ in all_elements(clause.mods) if m.kind)
    return names


def all_elements(mods: Modifiers | None, kind: str = "", depth: int = 1) -> Iterator[tuple[Modifier, str, int]]:
    """Every element with the kind of list that it stands in, and how deep.

    The list of a class redeclaration becomes that of a short class.
    """
    for element in mods.elements if mods else ():
        yield element, kind, depth
        inner = ("short", 1) if element.kind == "class" else (element.kind or kind, depth + 1)
        yield from all_elements(element.inner, *inner)


def _problems(clause: Clause, again: set[str], texts: Sequence[str]) -> Iterator[tuple[int, str]]:
    plain = clause.owner.source.plain
    if clause.kind == "short" and clause.target == "der":
        yield (
            clause.start,
            f"'{clause.name} = der(...)' is not supported: write the derivative as a function of its own",
        )
    if clause.kind == "short" and clause.owner.kind == "package":
        yield from _functions_of_packages(plain, clause.mods)
    for element, _, _ in all_elements(clause.mods):
        if element.kind == "class" and _keyword(plain, element) == "package":
            yield from _functions_of_packages(plain, element.inner)
    yield from _of_elements(clause)
    for mods in _evaluated(clause):
        yield from _not_constant(plain, mods, texts)
    if clause.limit is None or clause.name not in again:
        return
    limited, limits = clause.limit
    if limits and clause.kind == "short":
        yield (
            limits.opening,
            f"modifiers of 'constrainedby {limited}' of a class that is redeclared are not supported: give them at "
            "the default and in the redeclaration",
        )
    elif clause.mods and clause.kind == "component":
        yield (
            clause.mods.opening,
            f"modifiers of '{clause.name}' beside a constrainedby-clause, when it is redeclared elsewhere, are not "
            f"supported: write constrainedby {limited}(...), which every redeclaration keeps",
        )


def _of_elements(clause: Clause) -> Iterator[tuple[int, str]]:
    for element, kind, depth in all_elements(clause.mods, clause.kind):
        if "." in element.name:
            first, _, rest = element.name.partition(".")
            yield element.named, f"modifier '{element.name}' is not supported: write {first}({rest} ...)"
        if element.kind and depth > 1:
            yield (
                element.start,
                f"redeclaring '{element.name}' inside the modifiers of another component is not supported: declare "
                "'model Mine = ...(redeclare ...)' and use Mine for the component",
            )
        redeclared = kind == "component" != clause.kind or element.kind == "component" or _within(clause, element)
        lost = redeclared or (depth > 1 and kind != "component")
        if element.inner and element.value and element.kind != "class" and lost:
            yield (
                element.named,
                f"value and attributes of '{element.name}' together are not supported in a redeclaration or this deep "
                f"in an extends clause: write the value alone, {element.name} = ..., and the attributes at its "
                "declaration",
            )


def _keyword(plain: str, element: Modifier) -> str:
    """What a redeclaration says that it declares: model, function, package."""
    found = re.search(r"(\w+)\s*\Z", plain[element.start : element.named])
    return found.group(1) if found else ""


def _functions_of_packages(plain: str, mods: Modifiers | None) -> Iterator[tuple[int, str]]:
    for element in mods.elements if mods else ():
        if element.kind == "class" and _keyword(plain, element) == "function":
            yield (
                element.start,
                f"redeclaring function '{element.name}' of a package here is not supported: declare 'package Mine "
                f"extends ...; redeclare function {element.name} = {element.target}; end Mine;' and use Mine",
            )


def names_in(clause: Clause, mods: Modifiers) -> bool:
    """Whether values of a list name variables or constants."""
    plain = clause.owner.source.plain
    values = [m.value for m, _, _ in all_elements(mods) if m.value is not None]
    return any(found.group(1) not in _BUILT_IN for value in values for found in _FREE_NAME.finditer(plain, *value))


def _within(clause: Clause, element: Modifier) -> bool:
    """Whether an element belongs to the redeclaration of a component."""
    return any(m.kind == "component" and m.start < element.start < m.end for m, _, _ in all_elements(clause.mods))


def _evaluated(clause: Clause) -> Iterator[Modifiers]:
    """Lists whose values the front end turns into numbers: of short classes inside models and of redeclarations."""
    parent = clause.owner.parent
    if clause.kind == "short" and clause.mods and parent and parent.is_model:
        yield clause.mods
    for element, _, _ in all_elements(clause.mods):
        if element.kind == "class" and element.inner:
            yield element.inner


def _not_constant(plain: str, mods: Modifiers, texts: Sequence[str]) -> Iterator[tuple[int, str]]:
    for element, _, _ in all_elements(mods):
        if element.value is None:
            continue
        for found in _FREE_NAME.finditer(plain, *element.value):
            name = found.group(1)
            if name not in _BUILT_IN and not _is_constant(name, texts):
                yield (
                    found.start(),
                    f"'{name}' in the modifiers of a class is not supported: it would be a number that no longer "
                    f"follows {name}; make a component replaceable and redeclare that, or write a constant",
                )


def _is_constant(name: str, texts: Sequence[str]) -> bool:
    """Whether a name means a class or a constant wherever it is declared, as far as words tell."""
    if any(re.search(rf"\bparameter\b[^;]*\b{name}\b", text) for text in texts):
        return False
    known = rf"\b(?:{KEYWORD[3:-1]}|import)\s+{name}\b|\bconstant\b[^;]*\b{name}\b"
    return any(re.search(known, text) for text in texts)


# -- what is rewritten


def _rewritten(
    source: Source, used: set[tuple[str, ...]], lost: Mapping[Key, Mapping[str, str]], kinds: Mapping[str, str]
) -> Source:
    """One change at a time, so that each sees the text as the last one left it."""
    for number in count(1):
        found = classes(source)
        changes = (
            edits
            for owner in found or ()
            if _path(owner) in used or owner.name.startswith("hystid_")
            for clause in clauses(owner)
            if (edits := _edits(clause, source, number) or _joined(clause, lost.get(key(clause), {}), kinds, number))
        )
        edits = next(changes, [])
        if not edits:
            return source
        source = edited(source, edits)
    raise AssertionError


def _edits(clause: Clause, source: Source, number: int) -> list[Edit]:
    if clause.limit and clause.limit[1]:
        return _moved(clause, clause.limit[1], source)
    if clause.kind == "extends" and clause.owner.kind == "package" and clause.mods:
        functions = [m for m in clause.mods.elements if m.kind == "class" and _keyword(source.plain, m) == "function"]
        if functions:
            return _behind(clause.mods, functions, source)
    for element, kind, depth in all_elements(clause.mods, clause.kind):
        if element.kind == "class" and element.inner:
            return _named(clause, element, element.inner, source, f"hystid_{element.name}_{number}")
        together = element.inner and element.value and element.kind != "class"
        if together and not (depth == 1 and kind == "component"):
            assert element.inner
            return [_split(element, element.inner, source)]
    return []


def _behind(mods: Modifiers, functions: Sequence[Modifier], source: Source) -> list[Edit]:
    """``extends P(redeclare function f = g);`` becomes ``extends P; redeclare function f = g;``, which acts."""
    text = source.text
    rest = ", ".join(one_line(text[m.start : m.end]) for m in mods.elements if m not in functions)
    moved = " ".join(f"{one_line(text[m.start : m.end])};" for m in functions)
    gap = "\n" * text.count("\n", mods.opening, mods.closing + 1)
    end = source.plain.index(";", mods.closing) + 1
    return [(mods.opening, mods.closing + 1, (f"({rest})" if rest else "") + gap), (end, end, f" {moved}")]


def _split(element: Modifier, inner: Modifiers, source: Source) -> Edit:
    """``each m(min = 0) = 1`` becomes ``each m(min = 0), each m = 1``."""
    again = source.plain[element.start : element.named] + element.name
    return (inner.closing + 1, inner.closing + 1, f", {again}")


def _named(clause: Clause, element: Modifier, inner: Modifiers, source: Source, name: str) -> list[Edit]:
    """``redeclare model S = Cub(k = 7)`` becomes a class of its own in front of the statement and its name."""
    text = source.text[inner.opening : inner.closing + 1]
    kind = re.search(r"(\w+)\s+\w+\s*\Z", source.plain[element.start : element.named] + element.name)
    first = f"{kind.group(1) if kind else 'model'} {name} = {element.target}{one_line(text)}; "
    target = (element.behind - len(element.target), element.behind, name)
    return [
        (clause.start, clause.start, first),
        target,
        (inner.opening, inner.closing + 1, "\n" * text.count("\n")),
    ]


def one_line(text: str) -> str:
    """A list without comments and line ends; strings stay."""
    found = re.sub(r'("(?:\\.|[^"\\])*")|//[^\n]*|/\*.*?\*/', lambda m: m.group(1) or " ", text, flags=re.DOTALL)
    return re.sub(r"\s*\n\s*", " ", found)


def _joined(clause: Clause, lost: Mapping[str, str], kinds: Mapping[str, str], number: int) -> list[Edit]:
    """``P p(m = 3)`` becomes ``model hystid_p_1 = P(m = 3); hystid_p_1 p``."""
    inside = clause.mods.elements if clause.mods and clause.kind == "component" else ()
    moved = [element.name for element in inside if element.name in lost]
    if not moved:
        return []
    text = clause.owner.source.text
    name = f"hystid_{clause.name}_{number}"
    kind = kinds.get(clause.target.rsplit(".", 1)[-1].strip(), "model")
    made = f"{kind} {name} = {clause.target}({', '.join(one_line(lost[m]) for m in moved)})"
    rest = ", ".join(one_line(text[m.start : m.end]) for m in inside if m.name not in moved)
    before = text[clause.start : clause.typed]
    assert clause.mods
    opening, closing = clause.mods.opening, clause.mods.closing + 1
    gap = "\n" * text.count("\n", opening, closing)
    return [
        (clause.start, clause.typed + len(clause.target), f"{made}; {before}{name}"),
        (opening, closing, (f"({rest})" if rest else "") + gap),
    ]


def _moved(clause: Clause, limit: Modifiers, source: Source) -> list[Edit]:
    """``Q f constrainedby P(n = 1)`` becomes ``Q f(n = 1) constrainedby P``; modifiers of f itself go first."""
    own = {m.name for m in clause.mods.elements} if clause.mods else set()
    wanted = [one_line(source.text[m.start : m.end]) for m in limit.elements if m.name not in own]
    gap = "\n" * source.text.count("\n", limit.opening, limit.closing + 1)
    cut = (limit.opening, limit.closing + 1, gap)
    if not wanted:
        return [cut]
    if clause.mods is None:
        return [cut, (clause.behind, clause.behind, f"({', '.join(wanted)})")]
    comma = ", " if clause.mods.elements else ""
    return [cut, (clause.mods.closing, clause.mods.closing, comma + ", ".join(wanted))]
