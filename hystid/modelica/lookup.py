"""Classes found by dotted name and lexical scope, and the texts cut down to those that a model needs.

Only files on the way to a class are read: of a library of thousands of files a model reaches some dozens. A name is
looked for in the class itself, its base classes, its imports, and then in the classes around it (Modelica
specification 3.6, section 5.3). Where a name may mean a class or a variable, the class counts as needed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from pathlib import Path

from hystid.errors import ModelicaError
from hystid.modelica.clauses import closing
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source, read

_DOTTED = r"[A-Za-z_]\w*(?:\s*\.\s*[A-Za-z_]\w*)*"
_NAME = re.compile(rf"(?<![\w.])\.?{_DOTTED}")
_IMPORT = re.compile(
    rf"(?<![\w.])import\s+(?:(?P<alias>[A-Za-z_]\w*)\s*=\s*)?(?P<name>{_DOTTED})\s*(?P<rest>\.\s*\*|\.\s*\{{[^}}]*\}})?"
)
_EXTENDS = re.compile(rf"(?<![\w.])extends\s+(\.?{_DOTTED})")
_SHORT = re.compile(rf"\s*(?:(?:input|output)\s+)*(\.?{_DOTTED})")
_GIVEN_PACKAGE = re.compile(rf"\bpackage\s+\w+\s*=\s*(\.?{_DOTTED})")
_EVALUATE = re.compile(r"\bEvaluate\s*=\s*true\b")
_PARAMETER = re.compile(r"\bparameter\s+(?!(?:Boolean|Integer|String)\b)")
_ANNOTATION = re.compile(r"(?<![\w.])annotation\s*\(")
_EXPERIMENT = re.compile(r"\bexperiment\s*\(")


class Need(IntEnum):
    """How much of a class is needed: its place alone, what it says itself, or every class in it too."""

    PLACE = 1
    ITSELF = 2
    ALL = 3


@dataclass(eq=False)
class ClassNode:
    """A class of the tree. folder: of a package that is a folder. file: path of its text below the library's root."""

    name: str
    parent: ClassNode | None
    declared: Class
    file: Path
    folder: Path | None = None
    inside: dict[str, ClassNode] = field(default_factory=dict)
    need: int = 0

    @property
    def source(self) -> Source:
        """The text that holds it."""
        return self.declared.source

    @property
    def nested(self) -> list[ClassNode]:
        """Classes in it that stand in the same text."""
        return [n for n in self.inside.values() if n.file == self.file]

    @cached_property
    def annotations(self) -> list[tuple[int, int]]:
        """What stands in the parentheses of its annotations."""
        found, at, plain = [], self.declared.body, self.source.plain
        while (next_one := _ANNOTATION.search(plain, at, self.declared.tail)) is not None:
            at = closing(plain, next_one.end() - 1)
            found.append((next_one.end(), at))
        return found

    @cached_property
    def own(self) -> str:
        """Its own text, without nested classes and annotations."""
        c, plain = self.declared, self.source.plain
        gone = sorted([*((n.declared.front, n.declared.end) for n in self.nested), *self.annotations])
        kept, at = [], c.body
        for start, end in gone:
            kept.append(plain[at:start])
            at = max(at, end)
        return "\n".join((*kept, plain[at : c.tail]))

    @cached_property
    def words(self) -> frozenset[str]:
        """Identifiers of its own text."""
        return frozenset(re.findall(r"[A-Za-z_]\w*", self.own))

    @cached_property
    def import_clauses(self) -> list[re.Match[str]]:
        """Its own import clauses, by their places in the text."""
        inner = [(n.declared.front, n.declared.end) for n in self.nested]
        found = _IMPORT.finditer(self.source.plain, self.declared.body, self.declared.tail)
        return [m for m in found if not any(start <= m.start() < end for start, end in inner)]

    @cached_property
    def imports(self) -> dict[str, str]:
        """Name -> full name; "*" before the name of a package of which every name is imported."""
        return {short: full for clause in self.import_clauses for short, full in imported_by(clause).items()}

    @cached_property
    def base_names(self) -> list[str]:
        """Names of its base classes as they are written."""
        if self.declared.short:
            found = _SHORT.match(self.source.plain, self.declared.body)
            return [_joined(found.group(1))] if found and found.group(1) != "enumeration" else []
        return [_joined(n) for n in _EXTENDS.findall(self.own)]

    @cached_property
    def _entries(self) -> frozenset[str]:
        """Names of the files and folders beside its own."""
        return frozenset(p.name for p in self.folder.iterdir()) if self.folder else frozenset()

    def child(self, name: str) -> ClassNode | None:
        """The class of that name declared in it, in a file of its folder maybe."""
        if name not in self.inside and self.folder is not None and {name, f"{name}.mo"} & self._entries:
            made = _loaded(self.folder, name, self)
            if made is not None:
                self.inside[name] = made
        return self.inside.get(name)

    def all_children(self) -> list[ClassNode]:
        """Every class declared in it."""
        if self.folder is not None:
            names = {p.stem for p in self.folder.glob("*.mo")} | {
                p.parent.name for p in self.folder.glob("*/package.mo")
            }
            for name in sorted(names - {"package"}):
                self.child(name)
        return list(self.inside.values())


def imported_by(clause: re.Match[str]) -> dict[str, str]:
    """What one import clause brings, as ``ClassNode.imports`` has it."""
    name, rest = _joined(clause["name"]), clause["rest"] or ""
    if "{" in rest:
        return {word: f"{name}.{word}" for word in re.findall(r"\w+", rest)}
    return {f"*{name}" if rest else clause["alias"] or name.rsplit(".", 1)[-1]: name}


def _joined(name: str) -> str:
    return re.sub(r"\s", "", name)


def _loaded(folder: Path, name: str, parent: ClassNode | None) -> ClassNode | None:
    """The class ``name`` from a file or folder below ``folder``; of a package in several versions the last."""
    place = parent.file.parent if parent is not None else Path()
    if (folder / f"{name}.mo").is_file():
        return _first(read(folder / f"{name}.mo"), name, parent, place / f"{name}.mo", None)
    package = folder / name
    if parent is None and not package.is_dir():
        package = max(folder.glob(f"{name} [0-9]*"), key=lambda p: _version(p.name), default=package)
    if (package / "package.mo").is_file():
        return _first(read(package / "package.mo"), name, parent, place / name / "package.mo", package)
    return None


def _version(name: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", name.partition(" ")[2]))


def _first(source: Source, name: str, parent: ClassNode | None, file: Path, folder: Path | None) -> ClassNode | None:
    found = classes(source)
    outer = next((c for c in found or () if c.parent is None and c.name == name), None)
    return _node(outer, found or (), parent, file, folder) if outer else None


def _node(
    c: Class, found: Sequence[Class], parent: ClassNode | None, file: Path, folder: Path | None = None
) -> ClassNode:
    made = ClassNode(c.name, parent, c, file, folder)
    made.inside = {d.name: _node(d, found, made, file) for d in found if d.parent is c}
    return made


class Tree:
    """Every class that can be named: those of the given texts, and those below folders, which are read when named.

    texts: read already, the files of a package below its place; folders: hold packages, as MODELICAPATH does.
    """

    def __init__(self, texts: Iterable[tuple[Source, Path]], folders: Sequence[Path]) -> None:
        self._folders = folders
        self._top: dict[str, ClassNode | None] = {}
        self._bases: dict[ClassNode, list[ClassNode]] = {}
        self._busy: set[ClassNode] = set()
        self._waiting: list[ClassNode] = []
        self.given: list[ClassNode] = []
        self.imported: set[tuple[ClassNode, str]] = set()  # imports that gave a name its meaning
        for source, file in sorted(texts, key=lambda item: (len(item[1].parts), item[1].name != "package.mo")):
            self._add(source, file)

    def _add(self, source: Source, file: Path) -> None:
        found = classes(source) or []
        parent = self._given(source.within) if source.within else None
        for c in (c for c in found if c.parent is None):
            made = _node(c, found, parent, file)
            (parent.inside if parent is not None else self._top)[c.name] = made
            self.given.append(made)

    def _given(self, name: str) -> ClassNode | None:
        node: ClassNode | None = None
        for part in name.split("."):
            node = self._top.get(part) if node is None else node.inside.get(part)
            if node is None:
                return None
        return node

    # -- names

    def top(self, name: str) -> ClassNode | None:
        """The outermost class of that name."""
        if name not in self._top:
            made = (_loaded(folder, name, None) for folder in self._folders)
            self._top[name] = next((node for node in made if node is not None), None)
        return self._top[name]

    def find(self, name: str) -> ClassNode | None:
        """The class of a full name; inherited classes count."""
        first, *rest = name.split(".")
        node = self.top(first)
        for part in rest:
            node = self.member(node, part) if node is not None else None
        return node

    def names(self, full: str) -> bool:
        """Whether a full name is that of a class, or maybe of a constant in one."""
        front, _, last = full.rpartition(".")
        holder = self.find(front) if front else None
        return self.find(full) is not None or (holder is not None and any(last in n.words for n in self._line(holder)))

    def bases(self, node: ClassNode) -> list[ClassNode]:
        """Its base classes, looked for in the classes around it."""
        if node not in self._bases:
            if node in self._busy:
                return []
            self._busy.add(node)
            found = [self._named(name, node, inherited=False) for name in node.base_names]
            if re.match(r"\w+\s+extends\b", node.source.plain[node.declared.start : node.declared.body]):
                around = self.bases(node.parent) if node.parent is not None else []
                found += [self.member(base, node.name) for base in around]
            self._busy.discard(node)
            self._bases[node] = [b for b in found if b is not None and b is not node]
            self._refuse_circle(node)
        return self._bases[node]

    def _refuse_circle(self, node: ClassNode) -> None:
        """Refuses a class that extends itself through the bases known so far."""
        seen: list[ClassNode] = []
        waiting = list(self._bases[node])
        while waiting:
            base = waiting.pop()
            if base is node:
                place = node.source.place(node.declared.start)
                raise ModelicaError(f"{place}: class '{node.name}' extends itself through its bases")
            if base not in seen:
                seen.append(base)
                waiting += self._bases.get(base, ())

    def member(self, node: ClassNode, name: str) -> ClassNode | None:
        """The class of that name in a class or its bases."""
        own = node.child(name)
        if own is not None:
            return own
        return next((m for base in self.bases(node) if (m := self.member(base, name)) is not None), None)

    def _named(self, name: str, scope: ClassNode, inherited: bool = True) -> ClassNode | None:
        """The class that a name means in a scope; None where it means none to its last part."""
        node, _used, rest = self._resolved(name, scope, inherited)
        return None if rest else node

    def _resolved(
        self, name: str, scope: ClassNode, inherited: bool
    ) -> tuple[ClassNode | None, list[ClassNode], list[str]]:
        """The last class along a dotted name, the classes on the way to it, and the parts behind it."""
        first, *rest = name.lstrip(".").split(".")
        used: list[ClassNode] = []
        if name.startswith("."):
            node = self.top(first)
        else:
            node, used = self._first(first, scope, inherited)
        while node is not None and rest and (inner := self.member(node, rest[0])) is not None:
            used.append(node if inner.parent is not node else inner)
            node = inner
            rest.pop(0)
        return node, used, rest

    def _first(self, name: str, scope: ClassNode, inherited: bool) -> tuple[ClassNode | None, list[ClassNode]]:
        """What a simple name means, and the class whose import or base classes gave it."""
        here: ClassNode | None = scope
        while here is not None:
            found = self.member(here, name) if inherited or here is not scope else here.child(name)
            if found is not None:
                return found, [] if found.parent is here else [here]
            if name in here.imports:
                self.imported.add((here, name))
                return self.find(here.imports[name]), [here]
            for key, package in here.imports.items():
                opened = self.find(package) if key.startswith("*") else None
                if opened is not None and (found := self.member(opened, name)) is not None:
                    self.imported.add((here, key))
                    return found, [here]
            if re.search(r"\bencapsulated\b", here.source.plain[here.declared.front : here.declared.start]):
                break
            here = here.parent
        return self.top(name), []

    def roots(self) -> list[ClassNode]:
        """The outermost classes that were read."""
        return [node for node in self._top.values() if node is not None]

    def names_beside(self, name: str) -> list[str]:
        """Full names that may have been meant: of the given texts, and of what lies beside a wrong part."""
        found = [n for node in self.given for n in _full_names(node)]
        first, *rest = name.split(".")
        node, front = self.top(first), first
        while node is not None and rest:
            found += [f"{front}.{child.name}" for child in node.all_children()]
            node, front = self.member(node, rest[0]), f"{front}.{rest[0]}"
            rest.pop(0)
        return found

    # -- needs

    def need(self, node: ClassNode, level: Need) -> None:
        """Marks a class, and what follows from that."""
        if node.need >= level:
            return
        plain = node.declared.short or node.declared.kind != "package"
        level = max(level, Need.ITSELF) if plain else level
        before, node.need = node.need, level
        if node.parent is not None:
            self.need(node.parent, Need.PLACE)
        if before < Need.ITSELF <= level:
            self._waiting.append(node)
        if level == Need.ALL or node.declared.kind != "package":
            for child in node.all_children():
                self.need(child, level)

    def follow(self) -> None:
        """Marks everything that the marked classes name."""
        while self._waiting:
            node = self._waiting.pop()
            text = node.own
            for base in self.bases(node):
                self.need(base, Need.ITSELF)
            for name in dict.fromkeys(_joined(n) for n in _NAME.findall(text)):
                self._follow(name, node)
            for target in _GIVEN_PACKAGE.findall(text):
                given = self._named(_joined(target), node)
                if given is not None:
                    self.need(given, Need.ALL)

    def _follow(self, name: str, scope: ClassNode) -> None:
        node, used, rest = self._resolved(name, scope, inherited=True)
        if node is None:
            self._mark_owner(name.split(".", 1)[0], scope)
            return
        for other in used:
            self.need(other, Need.ITSELF if other is not node else Need.PLACE)
        whole = rest or node.declared.kind != "package" or node.declared.short
        self.need(node, Need.ITSELF if whole else Need.PLACE)

    def _mark_owner(self, word: str, scope: ClassNode) -> None:
        """A name that is no class may be a constant of a package around, or of one of its bases."""
        here = scope.parent
        while here is not None:
            if here.need < Need.ITSELF and any(word in n.words for n in self._line(here)):
                self.need(here, Need.ITSELF)
            here = here.parent

    def _line(self, node: ClassNode) -> Iterator[ClassNode]:
        seen: set[ClassNode] = set()
        waiting = [node]
        while waiting:
            here = waiting.pop()
            if here not in seen:
                seen.add(here)
                yield here
                waiting += self.bases(here)


def _full_names(node: ClassNode) -> Iterator[str]:
    around, here = [node.name], node.parent
    while here is not None:
        around, here = [here.name, *around], here.parent
    yield ".".join(around)
    for child in node.inside.values():
        yield from _full_names(child)


def cut(tree: Tree, name: str, given: Sequence[tuple[Source, Path]]) -> list[tuple[Source, Path]]:
    """The texts of the tree's folders, with their places, that class ``name`` needs; lines stay where they are.

    given: the texts that are there in any case.
    """
    main = tree.find(name)
    for node in [main] if main is not None else tree.given:
        tree.need(node, Need.ALL)
    tree.follow()
    known = {source.path for source, _ in given}
    roots = [node for node in tree.roots() if node.source.path not in known]
    texts: dict[Path, tuple[Source, list[tuple[int, int]]]] = {}
    for node in (n for root in roots for n in _needed(root)):
        _, blanks = texts.setdefault(node.file, (node.source, []))
        blanks += _unneeded(node, node is main)
    return [(Source(source.path, _blanked(source.text, blanks)), file) for file, (source, blanks) in texts.items()]


def without_idle_imports(source: Source, tree: Tree) -> Source:
    """The text without the imports through which the needed classes name nothing: the front end looks for them all."""
    spans = [span for node in tree.given if node.source == source for span in _idle_imports(node, tree)]
    return Source(source.path, _blanked(source.text, spans)) if spans else source


def _idle_imports(node: ClassNode, tree: Tree) -> Iterator[tuple[int, int]]:
    for clause in node.import_clauses:
        if not any((node, name) in tree.imported for name in imported_by(clause)):
            yield clause.start(), node.source.plain.index(";", clause.end()) + 1
    for child in node.nested:
        yield from _idle_imports(child, tree)


def _needed(node: ClassNode) -> Iterator[ClassNode]:
    if node.need:
        yield node
        for child in node.inside.values():
            yield from _needed(child)


def _unneeded(node: ClassNode, main: bool) -> Iterator[tuple[int, int]]:
    """Stretches that may go; an experiment is kept for the model itself, and that a number may be evaluated."""
    c = node.declared
    yield from ((n.declared.front, n.declared.end) for n in node.nested if not n.need)
    if node.need == Need.PLACE:
        at = c.body
        for n in sorted((n for n in node.nested if n.need), key=lambda n: n.declared.front):
            yield at, n.declared.front
            at = n.declared.end
        yield at, c.tail
        return
    for start, end in node.annotations:
        if evaluated := _evaluated(node.source.plain, start, end):
            yield from ((start, evaluated[0]), (evaluated[1], end))
        elif not (main and _EXPERIMENT.search(node.source.plain, start, end)):
            yield start, end


def _evaluated(plain: str, start: int, end: int) -> tuple[int, int] | None:
    """Where ``Evaluate = true`` stands between two offsets, in the annotation of what may be a Real parameter."""
    found = _EVALUATE.search(plain, start, end)
    declared = _PARAMETER.search(plain, max(plain.rfind(";", 0, start), 0), start) if found else None
    return found.span() if found and declared else None


def _blanked(text: str, spans: Iterable[tuple[int, int]]) -> str:
    made, at = [], 0
    for start, end in sorted(spans):
        if end > at:
            made += [text[at : max(start, at)], " " + "\n" * text.count("\n", max(start, at), end)]
            at = end
    return "".join((*made, text[at:]))
