"""All effects together: what holds for a law in all its forms, which laws are one class, and how a class is called."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from hystid.diagnosis.model.channel_effects import CHANNELS
from hystid.diagnosis.model.effects import Effect
from hystid.diagnosis.model.semantics import OF_THE_LAW, Alike, Semantics, Telling
from hystid.errors import ModelicaError
from hystid.modelica.sources import near


@dataclass(frozen=True)
class Catalogue:
    """Id -> what the law declares, faults of channels included."""

    laws: Mapping[str, Semantics] = field(default_factory=dict)

    def title(self, ident: str) -> str:
        """Display name of a law: its id in words where it declares none."""
        said = self.laws.get(ident)
        return said.title if said is not None and said.title else ident.replace("_", " ")

    def class_title(self, idents: Sequence[str]) -> str:
        """The one display name of laws that cannot be told from each other, the leading one first: that which two
        equal laws declare, else the family that all share, else the titles of two, or that of the leading one."""
        members = list(dict.fromkeys(idents))
        if len(members) == 2:
            told = [one.title for one in self.alike(members[0]) if one.law == members[1] and one.title]
            if told:
                return told[0]
        families = {self.laws[one].family if one in self.laws else "" for one in members}
        if len(members) > 1 and len(families) == 1 and "" not in families:
            return families.pop()
        return ", or ".join(map(self.title, members)) if len(members) == 2 else self.title(members[0])

    def alike(self, ident: str) -> list[Alike]:
        """Laws that are declared to be equal to one, by itself or by the other one."""
        own = list(self.laws[ident].alike) if ident in self.laws else []
        known = {one.law for one in own}
        for other, said in self.laws.items():
            own += [replace(one, law=other) for one in said.alike if one.law == ident and other not in known]
        return own

    def equal(self, ident: str, beside: Iterable[str] = ()) -> tuple[str, ...]:
        """Ids that are the same as a law by algebra, in all recordings. beside: ids that are named with it."""
        found = [one.law for one in self.alike(ident) if not one.provided and one.unless not in {*beside}]
        return tuple(sorted({ident, *found})) if found else ()

    def telling(self, idents: Iterable[str]) -> Iterator[tuple[str, Telling]]:
        """Experiments that tell two of some laws from each other: id of the one, and what tells it from the other."""
        members = {*idents}
        for ident in sorted(members & {*self.laws}):
            yield from ((ident, one) for one in self.laws[ident].tells if one.law in members)


def catalogue_of(effects: Sequence[Effect]) -> Catalogue:
    """The catalogue of effects that ``with_laws`` has made complete."""
    return Catalogue({**CHANNELS, **{effect.id: effect.semantics for effect in reversed(effects)}})


def with_laws(effects: Sequence[Effect]) -> list[Effect]:
    """Effects of which every form has what its law declares. Raises ModelicaError where a declaration names a law that
    does not exist, and where a form declares what is stated for its law."""
    first: dict[str, Effect] = {}
    for effect in sorted(effects, key=lambda e: e.form != ""):
        first.setdefault(effect.id, effect)
    known = {*first, *CHANNELS}
    found = []
    for effect in effects:
        _check_laws(effect.semantics, known)
        law = first[effect.id]
        if effect is not law:
            own = [key for key in OF_THE_LAW if key in effect.semantics.places]
            if own:
                place = effect.semantics.places[own[0]]
                block = law.class_name.rpartition(":")[2].rpartition(".")[2]
                raise ModelicaError(f"{place}: {own[0]} holds for all forms of {effect.id}: state it in {block}")
        shared = {key: getattr(law.semantics, key) for key in OF_THE_LAW}
        shared |= {"title": effect.semantics.title or law.semantics.title}
        found.append(replace(effect, semantics=replace(effect.semantics, **shared)))
    return found


def _check_laws(said: Semantics, known: set[str]) -> None:
    for key in ("becomes", "alike", "tells"):
        for one in getattr(said, key):
            for law in (one.law, *([one.unless] if isinstance(one, Alike) else [])):
                if law and law not in known:
                    raise ModelicaError(f"{said.places[key]}: {key}: there is no law '{law}'{near(law, known)}")
