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


NESTED = """package Laws
  package Springs
    partial model Base
      parameter Real k = 1;
    end Base;
    model Spring
      extends Base;
      Real f = k*time;
    end Spring;
  end Springs;
end Laws;
"""


def test_a_short_name_of_a_class_in_a_package_is_answered_with_the_full_one(tmp_path: Path) -> None:
    file = tmp_path / "laws.mo"
    file.write_text(NESTED)
    for wrong in ("Spring", "Springs.Spring", "Law.Springs.Spring"):
        with pytest.raises(ModelicaError, match=rf"no class '{wrong}'; did you mean 'Laws\.Springs\.Spring'"):
            compile_model(f"{file}:{wrong}")


def test_the_only_model_of_a_file_needs_no_name_wherever_it_stands(tmp_path: Path) -> None:
    file = tmp_path / "laws.mo"
    file.write_text(NESTED)
    assert "f" in {v.name for v in compile_model(str(file)).variables}
    file.write_text(
        NESTED.replace("end Springs;", "model Other = Spring;\n model Third Real y = time; end Third; end Springs;")
    )
    with pytest.raises(ModelicaError, match=r"its models are Laws\.Springs\.Spring, Laws\.Springs\.Third"):
        compile_model(str(file))


def test_a_package_in_one_file_of_a_library_folder_is_found(tmp_path: Path) -> None:
    """With its own mistakes told by file and line."""
    folder = tmp_path / "lib"
    folder.mkdir()
    (folder / "Laws.mo").write_text(NESTED)
    found = compile_model("Laws.Springs.Spring", libraries=[folder])
    assert "f" in {v.name for v in found.variables}
    for wrong, said in (
        ("q*time", "'q' is not declared"),
        ("sin(k, time)", r"sin\(\) expects 1"),
        ("k*;", "syntax error"),
    ):
        (folder / "Laws.mo").write_text(NESTED.replace("k*time", wrong))
        with pytest.raises(ModelicaError, match=rf"lib.Laws\.mo:8: {said}"):
            compile_model("Laws.Springs.Spring", libraries=[folder])


def test_a_keyword_is_no_near_name(tmp_path: Path) -> None:
    (tmp_path / "rig.mo").write_text(
        "model Rig\n  Real y = foo(time);\nequation\n  for i in 1:0 loop y = 1; end for;\nend Rig;"
    )
    with pytest.raises(ModelicaError) as said:
        compile_model(f"{tmp_path / 'rig.mo'}:Rig")
    assert "'foo' is not declared" in str(said.value) and "'for'" not in str(said.value)


def test_a_long_complaint_is_told_whole(tmp_path: Path) -> None:
    (tmp_path / "rig.mo").write_text("model Rig\n  Real x = 1;\n  Real x = 2;\nend Rig;")
    with pytest.raises(ModelicaError, match=r"rig\.mo:3: syntax error: Duplicate .* \(first declared at line 2\)"):
        compile_model(f"{tmp_path / 'rig.mo'}:Rig")


@pytest.mark.parametrize("text", ["function flow input Real q; end flow;", "Real flow = 1;", "Real v[3], loop;"])
def test_a_keyword_is_no_name(tmp_path: Path, text: str) -> None:
    """A syntax error in line 1 at 'Rig' was told, or that 'function' is the keyword."""
    (tmp_path / "rig.mo").write_text(f'model Rig "a flow"\n  parameter Real k = 1;\n  {text}\nend Rig;')
    with pytest.raises(ModelicaError, match=r"rig\.mo:3: syntax error: '(flow|loop)'"):
        compile_model(f"{tmp_path / 'rig.mo'}:Rig")


IMPORTS = """package P
  import SI = Modelica.Units.SI;
  import Modelica.Constants.pi;
  import Modelica.{Math, Units};
  import Nowhere.At.All;
  model Bare
    Real x(start = 1, fixed = true);
  equation
    der(x) = -x;
  end Bare;
  model Slow
    import Foo.Bar;
    SI.Velocity v(start = 1, fixed = true);
    parameter SI.Time T = 2*pi;
  equation
    T*der(v) = -v;
  end Slow;
end P;
"""


def test_imports_that_a_model_does_not_use_ask_for_nothing(tmp_path: Path) -> None:
    (tmp_path / "p.mo").write_text(IMPORTS)
    assert "x" in {v.name for v in compile_model(f"{tmp_path}/p.mo:P.Bare").variables}
    assert "v" in {v.name for v in compile_model(f"{tmp_path}/p.mo:P.Slow").variables}


@pytest.mark.parametrize("clause", ["Modelica.Parts.*", "Modelica.Parts", "Parts = Modelica.Parts"])
def test_a_library_that_is_imported_and_absent_is_asked_for(
    clause: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: Path
) -> None:
    monkeypatch.delenv("MODELICAPATH", raising=False)
    kind = "Spring" if "*" in clause else "Parts.Spring"
    (tmp_path / "p.mo").write_text(f"package P\n  import {clause};\n  model A\n    {kind} spring;\n  end A;\nend P;\n")
    with pytest.raises(ModelicaError, match=r"p\.mo:2: there is no class 'Modelica\.Parts'; .*--library"):
        compile_model(f"{tmp_path}/p.mo:P.A")
    assert "spring.f" in {v.name for v in compile_model(f"{tmp_path}/p.mo:P.A", libraries=[library]).variables}
