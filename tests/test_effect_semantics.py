"""What an effect declares of itself: read from its block, checked, and the only place where it stands."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hystid.diagnosis import Diagnosis, Finding
from hystid.diagnosis.decide.criterion import Candidate, FittedSet, Posterior
from hystid.diagnosis.decide.trials import are_reached
from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis, Term
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.model.catalogue import Catalogue, catalogue_of, with_laws
from hystid.diagnosis.model.effects import Effect, Signals
from hystid.diagnosis.model.library import load_effects
from hystid.diagnosis.model.semantics import KEYWORD, Semantics, semantics_of
from hystid.diagnosis.prepare.steered import is_steered
from hystid.diagnosis.tell.advice import next_experiment
from hystid.diagnosis.tell.findings import headline
from hystid.diagnosis.tell.result import Errors, Where
from hystid.errors import ModelicaError, UsageError
from hystid.modelcode import Variable
from hystid.modelica.sources import library_folder
from hystid.modelica.vendor import vendor_annotation
from hystid.report.diagnosis import summary

ROOT = Path(__file__).parents[1]
BLOCK = """block Own "A contact of one's own"
  extends HystId.Interfaces.PartialEffect;
  parameter Real k(unit="N/m") = 0 "Stiffness";
  parameter Real {gap}(unit="m", min=0) = 0.001 "Displacement at which contact changes";
  parameter Integer {side}(min=-1, max=1) = 1 "Side";
equation
  f = {side}*k*noEvent(if {side}*x > {gap} then {side}*x - {gap} else 0);
  annotation(Documentation(info="<html><p>Text with __HystId_effect( in a string.</p></html>"){said});
end Own;
"""


def block(folder: Path, said: str = "", gap: str = "gap", side: str = "side", name: str = "own.mo") -> Path:
    place = folder / name
    text = BLOCK.format(gap=gap, side=side, said=f",\n    {KEYWORD}({said})" if said else "")
    place.write_text(text, encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def effects() -> list[Effect]:
    return load_effects()


@pytest.fixture(scope="module")
def catalogue(effects: list[Effect]) -> Catalogue:
    return catalogue_of(effects)


def declared(place: Path) -> Semantics:
    """The annotation of a block, checked against the parameters that the block has."""
    variables = [
        Variable("k", 0, "parameter", "tunable", unit="N/m"),
        Variable("gap", 1, "parameter", "tunable", unit="m"),
        Variable("side", 2, "parameter", "tunable", "Integer", min=-1, max=1),
    ]
    return semantics_of(vendor_annotation(f"{place}:Own", KEYWORD), variables, ("k",))


@pytest.mark.parametrize(
    ("said", "rule"),
    [
        ("titel = \"a\"", r"has no 'titel'.*did you mean 'title'"),
        ("title = gap", "title is a string in quotes"),
        ("title = \"a\", title = \"b\"", "'title' stands twice"),
        ("threshold = gab", "no parameter of that name.*did you mean 'gap'"),
        ("threshold = \"gap\"", "the name of a parameter, without quotes"),
        ("threshold = k", "its unit is m, that of k is N/m"),
        ("threshold = side", "its unit is m, that of side is 1"),
        ("switch = k", "an Integer parameter with min and max"),
        ("needs = {\"tide\"}", "needs knows 'time'.*not 'tide'"),
        ("needs = \"time\"", "a list in braces"),
        ("lasting = 1", "lasting is true or false"),
        ("becomes = {End(law = \"impact\", of = k)}", "End says one of above, below, at, over and one_sided"),
        ("becomes = {End(law = \"impact\", of = k, above = 1, per = \"mile\")}", "per knows 'stroke'.*not 'mile'"),
        ("becomes = {End(law = \"impact\", of = k, above = 1, per = gab)}", "no parameter of that name.*mean 'gap'"),
        ("becomes = {End(of = k, above = 1)}", "End must say 'law'"),
        ("becomes = {Start(law = \"impact\")}", r"a list of End\(...\)"),
        ("alike = {Alike(law = \"impact\", provided = \"rain\")}", "provided knows 'constant', not 'rain'"),
        ("tells = {Telling(law = \"impact\")}", "Telling must say 'experiment'"),
        ("title \"a\"", "'title = value' was expected"),
        ("title = ;", "cannot stand in an annotation"),
    ],
)  # fmt: skip
def test_a_wrong_annotation_is_one_sentence_with_file_and_line(tmp_path: Path, said: str, rule: str) -> None:
    place = block(tmp_path, said)
    with pytest.raises(ModelicaError, match=rule) as refused:
        declared(place)
    assert str(refused.value).startswith(f"{place}:9: ") and "\n" not in str(refused.value)


def test_a_law_that_does_not_exist_is_refused(tmp_path: Path, effects: list[Effect]) -> None:
    said = declared(block(tmp_path, 'alike = {Alike(law = "impakt")}'))
    own = replace(effects[0], id="own", form="", semantics=said)
    with pytest.raises(ModelicaError, match=r"own.mo:9: alike: there is no law 'impakt'; did you mean 'impact'"):
        with_laws([*effects, own])


def test_a_form_declares_only_what_is_its_own(tmp_path: Path, effects: list[Effect]) -> None:
    law = next(e for e in effects if e.form == "Hertz")
    said = declared(block(tmp_path, 'family = "mine"'))
    with pytest.raises(ModelicaError, match=f"family holds for all forms of {law.id}"):
        with_laws([e if e is not law else replace(e, semantics=said) for e in effects])


def test_a_form_may_have_a_title_of_its_own(effects: list[Effect]) -> None:
    titles = {(e.id, e.form): e.semantics.title for e in with_laws(effects)}
    assert titles["linear_stiffness", "Lost"] == "linear spring that is lost"
    assert titles["two_sided_stop", "Hertz"] == titles["two_sided_stop", ""]


def test_strings_comments_and_numbers_of_an_annotation(tmp_path: Path) -> None:
    said = (
        'title = "one" + " and \\"two\\"", /* not */ needs = {}, lasting = true, threshold = gap, // none\n'
        '  becomes = {End(law = "", of = gap, below = -1.5e-3)}'
    )
    found = declared(block(tmp_path, said))
    assert found.title == 'one and "two"' and found.lasting and found.needs == () and found.threshold == "gap"
    assert found.becomes[0].below == -1.5e-3
    assert declared(block(tmp_path)) == Semantics()


def problem_of(x: np.ndarray) -> Problem:
    """What ``are_reached`` looks at: one recording of a motion."""
    v = np.gradient(x, 1e-3)
    part = SimpleNamespace(x=x, v=v, dt=1e-3)
    signals = [Signals(x, v, np.gradient(v, 1e-3), np.zeros(len(x)), 1e-3)]
    scales = SimpleNamespace(x=np.sort(np.abs(x)), v=np.sort(np.abs(v)))
    return SimpleNamespace(parts=(part,), scales=scales, signals=lambda h: signals)  # type: ignore[return-value]  # what is asked of a problem here


def test_a_parameter_is_a_threshold_only_where_it_is_declared(tmp_path: Path) -> None:
    """A user's ``gap`` is nothing special, and a threshold of any other name has every right."""
    x = 1e-3 * np.sin(np.linspace(0, 60, 4000))
    silent = block(tmp_path, name="silent.mo")
    named = block(tmp_path, "threshold = depth, switch = way", "depth", "way", "named.mo")
    (plain,) = [e for e in load_effects([silent]) if e.id == "own"]
    (own,) = [e for e in load_effects([named]) if e.id == "own"]
    for effect, gap, side, reached in ((plain, "gap", "side", True), (own, "depth", "way", False)):
        values = {"k": 1e4, gap: 2e-3, side: 1.0}  # the motion ends at 1 mm
        fit = Fit(Hypothesis({}, (Term(effect, values),)), np.zeros(1), 1.0)
        assert are_reached(problem_of(x), fit) is reached
        within = Fit(Hypothesis({}, (Term(effect, {**values, gap: 0.5e-3}),)), np.zeros(1), 1.0)
        assert are_reached(problem_of(x), within)


@pytest.mark.parametrize(
    ("text", "ids"),
    [
        (f"package My\n{BLOCK}end My;", {"own"}),
        ("/*\n block of rubber */\n" + BLOCK.replace("<p>Text", "<p>\n  model of rubber"), {"own"}),
        (
            BLOCK.replace("  parameter", "  block Inner\n    Real y = 1;\n  end Inner;\n  Inner part;\n  parameter", 1),
            {"own"},
        ),
        (f"{BLOCK}{BLOCK.replace('Own', 'Other')}", {"own", "other"}),
    ],
)
def test_blocks_of_a_file_are_those_at_its_top_and_in_its_packages(tmp_path: Path, text: str, ids: set[str]) -> None:
    place = tmp_path / "own.mo"
    place.write_text(text.format(gap="gap", side="side", said=""))
    assert {e.id for e in load_effects([place, place]) if e.class_name.startswith(str(place))} == ids


@pytest.mark.parametrize(
    ("was", "now", "told"),
    [
        ("Own", "CubicStiffness", "there is HystId.Effects.CubicStiffness already: give the block another name"),
        ("k*noEvent", "k*sqrt(-1 - abs(x/gap))*noEvent", "own.mo:Own: with its own values f is not finite"),
        ("max=1)", "max=1000000000)", "side, an Integer, is tried at each value between its min and max, at most 20"),
    ],
)
def test_a_block_that_cannot_be_told_or_tried_is_refused(tmp_path: Path, was: str, now: str, told: str) -> None:
    place = block(tmp_path)
    place.write_text(place.read_text().replace(was, now))
    with pytest.raises(UsageError, match=told):
        load_effects([place])


def test_a_block_that_was_edited_is_read_again(tmp_path: Path) -> None:
    found = []
    for lowest in ("0", "1e-4"):
        place = block(tmp_path)
        place.write_text(place.read_text().replace('unit="m", min=0', f'unit="m", min={lowest}'))
        found += [e.lowest["gap"] for e in load_effects([place]) if e.id == "own"]
    assert found == [0.0, 1e-4]


def test_two_stops_are_two_where_the_motion_reaches_both(effects: list[Effect]) -> None:
    """A fit that moves one of them out of the way is a one-sided contact."""
    swing = 1e-3 * np.sin(np.linspace(0, 60, 4000))
    for effect in (e for e in effects if e.id == "two_sided_stop"):
        lean = {"lean": 0.0} if any(shape.name == "lean" for shape in effect.shapes) else {}

        def reached(x: np.ndarray, effect: Effect = effect, **changed: float) -> bool:
            values = {"k": 1e4, "gap": 0.6e-3, **changed}
            return are_reached(problem_of(x), Fit(Hypothesis({}, (Term(effect, values),)), np.zeros(1), 1.0))

        assert reached(swing, **lean)
        assert not reached(swing + 0.5e-3, **lean)
        if lean:  # the stops stand at 0.6 mm and 2.4 mm, and at 0.6 mm and 0.8 mm
            assert not reached(swing, lean=-0.75)
            assert reached(swing, lean=-0.25)


def test_every_law_of_the_library_has_a_name_and_an_experiment(effects: list[Effect], catalogue: Catalogue) -> None:
    titles = {effect.id: effect.semantics.title for effect in effects}
    assert all(titles.values()) and len({*titles.values()}) == len(titles)
    assert all(effect.semantics.experiment for effect in effects)


def test_one_display_name_for_a_class(catalogue: Catalogue) -> None:
    assert catalogue.class_title(["backlash", "two_sided_stop"]) == "play between two stops"
    assert catalogue.class_title(["two_sided_stop", "backlash"]) == "play between two stops"
    assert catalogue.class_title(["contact_loss"]) == "one-sided contact beyond a gap"
    assert catalogue.class_title(["coulomb_friction", "stribeck_friction"]) == "dry friction"
    assert catalogue.class_title(["impact", "preload"]) == "impact, or constant force"
    assert catalogue.title("own_law") == "own law"


def test_equal_laws_are_a_class_both_ways(catalogue: Catalogue) -> None:
    assert catalogue.equal("backlash") == catalogue.equal("two_sided_stop") == ("backlash", "two_sided_stop")
    assert catalogue.equal("backlash", beside=["pinching"]) == ()
    assert catalogue.equal("force_gain") == catalogue.equal("added_mass") == ("added_mass", "force_gain")
    assert catalogue.equal("preload") == catalogue.equal("force_drift") == ()  # only where the drift is constant


def test_no_id_of_an_effect_stands_in_python() -> None:
    """Python knows what blocks declare, never which block it is. Benchmarks and tests make cases, and may."""
    ids = {effect.id for effect in load_effects()}
    several = re.compile(rf"\b({'|'.join(i for i in ids if '_' in i)})\b")
    found = []
    for path in sorted([*(ROOT / "hystid").rglob("*.py"), *(ROOT / "docs").rglob("*.py")]):
        text = path.read_text(encoding="utf-8")
        found += [f"{path.name}: {word[0]}" for word in several.finditer(text)]  # comments and texts as well
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Constant) and node.value in ids:
                found.append(f"{path.name}:{node.lineno}: {node.value}")
    assert not found


def test_the_annotation_is_a_vendor_annotation_of_every_law() -> None:
    silent = [
        path.name
        for path in (library_folder() / "HystId" / "Effects").glob("*.mo")
        if "__" not in path.stem and path.stem != "package" and KEYWORD not in path.read_text(encoding="utf-8")
    ]
    assert not silent


def shaken(x: np.ndarray, force: np.ndarray, *, timed: bool = True) -> SimpleNamespace:
    """What the advice looks at of a problem."""
    return SimpleNamespace(parts=[SimpleNamespace(x=x, F=force, timed=timed, lowest=0.0)])


def motions() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A sweep, noise in a band, and a ground motion that rises and dies away."""
    t = np.arange(8000) * 1e-3
    sweep = 20 * np.sin(2 * np.pi * (2 * t + 3.5 * t**2))
    noise = np.convolve(np.random.default_rng(3).standard_normal(len(t)), np.hanning(30), mode="same")
    return sweep, noise, noise * (t / 2) ** 2 * np.exp(-t)


def test_motion_under_control_is_told_from_what_happened_to_the_structure() -> None:
    sweep, noise, quake = motions()
    for force in (sweep, 0.1 * np.std(sweep) * noise / np.std(noise) + sweep):  # 20 dB
        assert is_steered(shaken(np.cumsum(noise), force).parts)
    for force in (noise, quake, np.zeros(len(noise))):  # free decays have no force
        assert not is_steered(shaken(quake, force).parts)
    assert is_steered(shaken(quake, quake, timed=False).parts)  # cycles of a testing machine


def answered(
    catalogue: Catalogue, force: np.ndarray, verdict: str, *classes: tuple[str, ...], **more: Any
) -> Diagnosis:
    """An answer with some classes of effects as findings."""
    where = Where("", (0, 0), (0, 0), {}, {}, "")
    found = tuple(Finding(c[0], c, 0.9, {}, where, {}, title=catalogue.class_title(c)) for c in classes)
    problem = shaken(np.cumsum(motions()[1]), force)
    return Diagnosis(verdict, "", "", {}, {}, found, catalogue=catalogue, problem=problem, **more)  # type: ignore[arg-type]  # fields by name


def test_the_next_experiment_can_be_done_and_tells_something(catalogue: Catalogue) -> None:
    sweep, _, quake = motions()
    friction = ("coulomb_friction", "stribeck_friction")
    assert "slow cycles" in next_experiment(answered(catalogue, sweep, "missing_physics", friction))
    for verdict, classes, more in (
        ("missing_physics", [friction], {}),
        ("unknown_physics", [], {}),
        ("consistent", [], {"untestable": ("stribeck_friction", "hysteretic_friction", "cyclic_degradation")}),
    ):
        told = next_experiment(answered(catalogue, quake, verdict, *classes, **more))
        assert told and "slow" not in told and "cycles" not in told, told
    weighed = next_experiment(answered(catalogue, quake, "missing_physics", ("added_mass", "force_gain")))
    assert "calibrate the force channel" in weighed  # needs no motion at all
    held = (Errors("held", (0.1, 0.1), (0.1, 0.1)),)
    assert next_experiment(answered(catalogue, sweep, "missing_physics", ("pinching",), holdout=held)) == ""
    hidden = answered(catalogue, sweep, "missing_physics", ("pinching",), untestable=("stribeck_friction",))
    assert "friction" not in next_experiment(hidden)  # what could not show is no matter of what was named
    unknown = answered(catalogue, sweep, "unknown_physics")
    assert unknown.problem is not None
    unknown.problem.parts[0].lowest = 6.0  # x from v: the place is not known
    assert "Record the displacement" in next_experiment(unknown)


def test_a_class_is_one_candidate_with_one_name(catalogue: Catalogue) -> None:
    """Never two names at half the confidence each."""
    rest = np.zeros(3)
    one = FittedSet((), 0, Fit(Hypothesis({}), rest, 1.0))
    names = {("two_sided_stop",): 0.46, ("backlash",): 0.44, ("pinching", "backlash"): 0.04, ("preload",): 0.01}
    ranked = tuple(Candidate(n, p, 0.9, one) for n, p in names.items())
    said = answered(
        catalogue, rest, "missing_physics", ("two_sided_stop", "backlash"), posterior=Posterior(0.01, 0.04, ranked)
    )  # fmt: skip
    told = [(c["title"], round(c["probability"], 9)) for c in said.as_dict()["candidates"]]
    assert told[0] == ("play between two stops", 0.9) and len(told) == 3
    assert said.as_dict()["findings"][0]["title"] == "play between two stops"
    assert headline(said).startswith("play between two stops (probability 90 %")
    assert "play between two stops (two_sided_stop, backlash)" in summary(said)
