"""What a user reads whose model names a class that is nowhere."""

from __future__ import annotations

from pathlib import Path

import pytest

from hystid.errors import ModelicaError
from hystid.modelica import compile_model

RIG = """model Rig
  parameter Real k = 1;
  Modelica.Parts.Spring spring(c = k);
  annotation(uses(Modelica(version = "4.1.0")));
end Rig;
model Other
  Modelica.Parts.Nothing nothing;
end Other;
"""


@pytest.fixture
def library(tmp_path: Path) -> Path:
    """A folder with something that calls itself the standard library."""
    folder = tmp_path / "lib" / "Modelica"
    folder.mkdir(parents=True)
    (folder / "package.mo").write_text(
        'package Modelica annotation(version = "4.1.0", conversion(from(version = {"3.2.3"})));\nend Modelica;\n'
    )
    (folder / "Parts.mo").write_text(
        "within Modelica;\npackage Parts\n  model Spring\n    parameter Real c = 2;\n    Real f = c*time;\n"
        "  end Spring;\n  model Old = Broken.Thing;\nend Parts;\n"
    )
    return tmp_path / "lib"


@pytest.fixture
def rig(tmp_path: Path):
    """rig(text): a file of it."""

    def write(text: str = RIG) -> str:
        (tmp_path / "rig.mo").write_text(text)
        return f"{tmp_path / 'rig.mo'}:Rig"

    return write


def test_the_folder_of_the_package_serves_as_well_as_the_one_that_holds_it(rig, library: Path) -> None:
    for folder in (library, library / "Modelica", library / "Modelica" / "Parts.mo"):
        assert "spring.f" in {v.name for v in compile_model(rig(), libraries=[folder]).variables}


def test_without_the_library_it_is_asked_for(rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MODELICAPATH", raising=False)
    with pytest.raises(ModelicaError, match=r"rig\.mo:3: there is no class 'Modelica\.Parts\.Spring'; .*--library"):
        compile_model(rig())
    with pytest.raises(ModelicaError, match=r"there is no class 'Modelica\.Parts\.Spring'; .*MODELICAPATH"):
        compile_model("Modelica.Parts.Spring")


def test_a_folder_of_the_environment_that_is_not_there_is_named(rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MODELICAPATH", "/no/such/folder")
    for model in (rig(), "Modelica.Parts.Spring"):
        with pytest.raises(ModelicaError, match=r"MODELICAPATH names /no/such/folder, where there is no folder"):
            compile_model(model)


def test_a_class_that_is_mistyped_is_named_with_near_ones(rig, library: Path) -> None:
    wrong = r"no class 'Modelica\.Parts\.Sprig'; did you mean 'Modelica\.Parts\.Spring'"
    with pytest.raises(ModelicaError, match=rf"rig\.mo:3: there is {wrong}"):
        compile_model(rig(RIG.replace("Spring", "Sprig")), libraries=[library])
    with pytest.raises(ModelicaError, match=rf"lib: there is {wrong}"):
        compile_model("Modelica.Parts.Sprig", libraries=[library])


def test_a_text_for_another_version_of_the_library_is_told_so(rig, library: Path) -> None:
    text = RIG.replace("Parts.Spring", "Older.Spring").replace("4.1.0", "3.2.3")
    words = r"rig\.mo:3: there is no class 'Modelica\.Older\.Spring' in version 4\.1\.0 .* written for 3\.2\.3"
    with pytest.raises(ModelicaError, match=words):
        compile_model(rig(text), libraries=[library])
