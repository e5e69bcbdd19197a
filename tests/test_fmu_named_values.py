"""Enumerations keep the names of their items in an FMU, and Strings their text, in importers of others."""

from __future__ import annotations

import zipfile

import fmpy
import fmu_checker
import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssv
from fmpy.validation import validate_fmu
from lxml import etree
from test_fmu_ssp import SCHEMA

from hystid.errors import UsageError
from hystid.fmu import Connection, Driver, build_model, write_ssp
from hystid.modelcode import code_data, code_of
from hystid.modelica import compile_model
from hystid.modelica.compile import flat_from_text
from hystid.modelica.flat import from_json, to_json

BOTH = pytest.mark.parametrize("version", [2, 3])
CONTACT = """package Laws
  type Law = enumeration(off, dry, viscous) "Law of a contact";
end Laws;
model Contact "A contact whose law is chosen"
  type State = enumeration(rest, motion);
  parameter Laws.Law law = Laws.Law.dry "Which law";
  parameter Laws.Law others[2] = {Laws.Law.off, Laws.Law.viscous};
  parameter String material = "steel \\"C45\\" & brass" "What touches what";
  input Real v(unit="m/s");
  input Laws.Law wanted "no start value: the first item";
  output Real f(unit="N");
  output State state;
  output Laws.Law now;
equation
  f = if law == Laws.Law.off then 0 elseif law == Laws.Law.dry then 2*tanh(v/1e-3) else 2*v;
  state = if abs(v) > 0.1 then State.motion else State.rest;
  now = wanted;
end Contact;
"""
LAWS, STATES = ("off", "dry", "viscous"), ("rest", "motion")


@pytest.fixture(scope="module")
def contacts(tmp_path_factory):
    """version -> FMU."""
    folder = tmp_path_factory.mktemp("contact")
    (folder / "Contact.mo").write_text(CONTACT)
    model = f"{folder / 'Contact.mo'}:Contact"
    return {v: build_model(model, folder / f"contact{v}.fmu", fmi=v).path for v in (2, 3)}


@BOTH
def test_importers_see_the_items(contacts, version):
    path = contacts[version]
    assert validate_fmu(str(path)) == [] and fmu_checker.problems(path) == []
    variables = {v.name: v for v in fmpy.read_model_description(str(path)).modelVariables}
    for name, items in (("law", LAWS), ("others[1]", LAWS), ("wanted", LAWS), ("now", LAWS), ("state", STATES)):
        declared = variables[name].declaredType
        assert variables[name].type == "Enumeration", name
        assert [(item.name, int(item.value)) for item in declared.items] == [(n, k) for k, n in enumerate(items, 1)]
    assert variables["law"].declaredType.name == "Laws.Law" and int(variables["law"].start) == 2
    assert int(variables["wanted"].start) == 1 and int(variables["others[2]"].start) == 3
    # a type and a variable may not share a name
    assert not {v.declaredType.name for v in variables.values() if v.declaredType} & set(variables)


@BOTH
def test_values_go_in_and_come_out(contacts, version):
    for law, force in ((1, 0.0), (2, 2 * np.tanh(500.0)), (3, 1.0)):
        rows = fmpy.simulate_fmu(
            str(contacts[version]), stop_time=0.1, output_interval=0.1,
            start_values={"law": law, "v": 0.5, "wanted": law}, output=["f", "state", "now"],
        )  # fmt: skip
        assert rows["f"][-1] == pytest.approx(force, rel=1e-12)
        assert (rows["state"][-1], rows["now"][-1]) == (2, law)
    ours = Driver(contacts[version]).simulate([0, 0.1], {"v": [0.0, 0.0]}, outputs=["state", "now"])
    assert list(ours["state"]) == [1, 1] and list(ours["now"]) == [1, 1]
    for name, value in (("law", 4), ("law", 0)):
        with pytest.raises(Exception, match="status 3"):  # FMPy raises bare exceptions
            fmpy.simulate_fmu(str(contacts[version]), stop_time=0.1, start_values={name: value})


@BOTH
def test_texts_can_be_read_and_not_set(contacts, version, capfd):
    folder = fmpy.extract(str(contacts[version]))
    description = fmpy.read_model_description(folder)
    (text,) = [v for v in description.modelVariables if v.type == "String"]
    assert (text.name, text.variability, text.description) == ("material", "constant", "What touches what")
    fmu = fmpy.instantiate_fmu(folder, description, "CoSimulation")
    if version == 2:
        fmu.setupExperiment()
    fmu.enterInitializationMode()
    (content,) = fmu.getString([text.valueReference])
    assert (content.decode() if isinstance(content, bytes) else content) == text.start == 'steel "C45" & brass'
    with pytest.raises(Exception, match="status 3"):
        fmu.setString([text.valueReference], ["copper"])
    with pytest.raises(Exception, match="status 3"):
        fmu.getString([text.valueReference + 1])
    fmu.freeInstance()
    assert "built in: change them in the model and build it again" in capfd.readouterr().out
    recorded = Driver(contacts[version]).record([0, 0.1], {}, outputs=["material"])
    assert list(recorded["material"]) == ['steel "C45" & brass'] * 2


def test_systems_keep_the_items(contacts, tmp_path):
    one = Connection("one.now", "two.wanted")
    path = write_ssp(tmp_path / "s.ssp", {"one": contacts[2], "two": contacts[2]},
                     [one, Connection("wanted", "one.wanted"), Connection("two.now", "now")],
                     inputs=["wanted"], outputs=["now"])  # fmt: skip
    root = etree.fromstring(zipfile.ZipFile(path).read("SystemStructure.ssd"))
    etree.XMLSchema(file=str(SCHEMA)).assertValid(root)
    (law,) = [e for e in root.iter("{*}Enumeration") if len(e) and e.get("name") == "Laws.Law"]
    assert [(item.get("name"), item.get("value")) for item in law] == [(n, str(k)) for k, n in enumerate(LAWS, 1)]
    rows = simulate_ssp(str(path), stop_time=0.01, step_size=1e-3, input={"wanted": lambda t: 3})
    assert rows["now"][-1] == 3
    given = write_ssp(tmp_path / "p.ssp", {"one": contacts[2]},
                      [Connection("v", "one.v"), Connection("one.f", "f")],
                      inputs=["v"], outputs=["f"], parameters={"one.law": 3})  # fmt: skip
    for values, force in ((read_ssv(str(given), "resources/parameters.ssv"), 1.0), (None, 2.0)):
        rows = simulate_ssp(
            str(given), stop_time=0.01, step_size=1e-3, parameter_set=values, input={"v": lambda t: 0.5}
        )
        assert rows["f"][-1] == pytest.approx(force)  # viscous where it is handed over, else dry
    with pytest.raises(UsageError, match=r"one\.state is Contact\.State, two\.wanted is Laws\.Law"):
        write_ssp(tmp_path / "t.ssp", {"one": contacts[2], "two": contacts[2]},
                  [Connection("one.state", "two.wanted")])  # fmt: skip


def test_names_outlast_both_forms_that_models_are_stored_in(tmp_path):
    (tmp_path / "Contact.mo").write_text(CONTACT)
    model = f"{tmp_path / 'Contact.mo'}:Contact"
    flat, code = flat_from_text(model), compile_model(model)
    assert from_json(to_json(flat)) == flat and len(flat.texts) == 1
    again = code_of(code_data(code))
    assert again == code and [e.name for e in again.enumerations] == ["Contact.State", "Laws.Law"]


def test_the_token_knows_the_names(tmp_path):
    tokens = set()
    for text in (CONTACT, CONTACT.replace("viscous", "damped"), CONTACT.replace("brass", "steel")):
        (tmp_path / "Contact.mo").write_text(text)
        tokens.add(compile_model(f"{tmp_path / 'Contact.mo'}:Contact").token)
    assert len(tokens) == 3
