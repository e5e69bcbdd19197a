"""FMU archives that would write outside their folder, fill the disk or load a foreign library."""

from __future__ import annotations

import math
import os
import re
import stat
import struct
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hystid.building import build
from hystid.cli.run import run
from hystid.errors import FmuError, UsageError
from hystid.files import _sweep
from hystid.fmu import Driver, build_model, regress
from hystid.fmu.door import open_fmu, read_entry

Content = dict[str, bytes]


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A temporary folder of the test's own, which must be empty in the end: nothing is left behind."""
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    yield place
    assert list(place.iterdir()) == []


@pytest.fixture(scope="module", params=[2, 3])
def good(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Content:
    path = build_model("HystId.Oscillators.Linear", tmp_path_factory.mktemp("good") / "a.fmu", fmi=request.param).path
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def _write(path: Path, content: Content) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    return path


def _described(good: Content, change: Callable[[str], str]) -> Content:
    old = good["modelDescription.xml"].decode()
    new = change(old)
    assert new != old
    return {**good, "modelDescription.xml": new.encode()}


def _refused(path: Path, says: str) -> None:
    with pytest.raises(FmuError, match=says) as caught:
        open_fmu(path)
    text = str(caught.value)
    assert "\n" not in text and len(text) < 1000 and text.startswith(path.name)


@pytest.mark.parametrize(
    "name", ["/etc/evil", "../evil", "a/../../evil", "..\\evil", "C:\\evil", "\\\\host\\evil", "//e"]
)
def test_entries_stay_inside(good: Content, tmp_path: Path, name: str) -> None:
    _refused(_write(tmp_path / "a.fmu", {name: b"evil", **good}), "outside its folder")


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR, stat.S_IFBLK, stat.S_IFSOCK])
@pytest.mark.parametrize("name", ["resources/link", "binaries"])
def test_links_and_devices_are_refused(good: Content, tmp_path: Path, kind: int, name: str) -> None:
    path = _write(tmp_path / "a.fmu", good)
    with zipfile.ZipFile(path, "a") as archive:
        entry = zipfile.ZipInfo(name)
        entry.create_system, entry.external_attr = 3, (kind | 0o777) << 16
        archive.writestr(entry, "/etc")
    _refused(path, "a link or a device")


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("name", ["modelDescription.xml", "MODELDESCRIPTION.XML", "./modelDescription.xml", "a//b"])
def test_duplicates_are_refused(good: Content, tmp_path: Path, name: str) -> None:
    path = _write(tmp_path / "a.fmu", {**good, "a/b": b""})
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(name, b"other")
    _refused(path, "twice")


@pytest.mark.parametrize(
    "identifier", ["/tmp/evil", "../../evil", "..", "a/b", "a\\b", "a b", "1a", "é", "a" * 300, "a.b", "$HOME", "a;b"]
)
def test_the_library_is_one_inside(good: Content, tmp_path: Path, identifier: str) -> None:
    """An absolute modelIdentifier named any library of the machine: the description chose what was loaded."""
    old = re.search(b'modelIdentifier="[^"]*"', good["modelDescription.xml"])[0].decode()
    changed = _described(good, lambda text: text.replace(old, f'modelIdentifier="{identifier}"'))
    _refused(_write(tmp_path / "a.fmu", changed), "no C identifier")


def test_a_file_where_a_folder_is_needed(good: Content, tmp_path: Path) -> None:
    _refused(_write(tmp_path / "a.fmu", {"binaries": b"", **good}), "damaged")
    _refused(_write(tmp_path / "b.fmu", {**good, "x" * 300: b""}), "damaged")


def test_bombs_are_refused_before_and_while_unpacking(
    good: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HYSTID_FMU_UNPACKED_MB", "3")
    path = _write(tmp_path / "a.fmu", {**good, "resources/zeros": bytes(4 << 20)})
    _refused(path, r"unpacks to \d+ MB, more than 3 MB \(HYSTID_FMU_UNPACKED_MB raises this\)")
    raw = path.read_bytes()
    lied = raw.replace(struct.pack("<I", 4 << 20), struct.pack("<I", 1000))  # the sizes in both headers
    assert lied != raw
    path.write_bytes(lied)
    _refused(path, "damaged|without an end")
    monkeypatch.delenv("HYSTID_FMU_UNPACKED_MB")
    path.write_bytes(raw)
    assert Driver(path).is_own


def test_large_descriptions_and_many_entries_are_refused(
    good: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    large = _described(good, lambda text: text + "<!--" + "x" * (33 << 20) + "-->")
    _refused(_write(tmp_path / "a.fmu", large), "HYSTID_FMU_DESCRIPTION_MB")
    many = {**good, **{f"resources/{i}": b"" for i in range(10_001)}}
    _refused(_write(tmp_path / "b.fmu", many), "HYSTID_FMU_ENTRIES")
    monkeypatch.setenv("HYSTID_FMU_ENTRIES", "lots")
    with pytest.raises(UsageError, match="a positive number is needed"):
        open_fmu(tmp_path / "b.fmu")


_LAUGHS = "".join("<!ENTITY a%d '%s'>" % (i + 1, f"&a{i};" * 10) for i in range(9))  # noqa: UP031
_DOCTYPES = [
    '<!DOCTYPE a [<!ENTITY b "c">]>',
    '<!DOCTYPE a SYSTEM "file:///etc/passwd">',
    '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>',
    '<!DOCTYPE a [<!ENTITY a0 "aaaaaaaaaa">'
    + "".join(f'<!ENTITY a{i + 1} "{f"&a{i};" * 10}">' for i in range(9))
    + "]>",
]


@pytest.mark.parametrize("doctype", _DOCTYPES)
def test_descriptions_have_no_document_type(good: Content, tmp_path: Path, doctype: str) -> None:
    changed = _described(good, lambda text: text.replace("<fmiModelDescription", f"{doctype}<fmiModelDescription", 1))
    _refused(_write(tmp_path / "a.fmu", changed), "document type")


@pytest.mark.parametrize("encoding", ["wurst", "utf-7", "utf-32", "ebcdic-cp-us", "rot13", "punycode"])
def test_odd_encodings_are_one_sentence(good: Content, tmp_path: Path, encoding: str) -> None:
    changed = _described(good, lambda text: text.replace("UTF-8", encoding).replace("utf-8", encoding))
    _refused(_write(tmp_path / "a.fmu", changed), "modelDescription.xml")


_NUMBERS = ["wurst", "", "1e", "0x10", "1,5", "--1", "9" * 5000, "-1", "4294967296", "99999999999999999999"]


@pytest.mark.parametrize("number", _NUMBERS)
@pytest.mark.parametrize(
    "attribute", ["valueReference", "startTime", "stopTime", "nominal", "start", "derivative", "min"]
)
def test_bad_numbers_are_one_sentence(good: Content, tmp_path: Path, attribute: str, number: str) -> None:
    """Every attribute that holds one, one after the other; a number that means something is taken."""
    text = good["modelDescription.xml"].decode()
    place = text.find(f' {attribute}="')
    if place < 0:
        pytest.skip(f"this description states no {attribute}")
    end = text.index('"', place + len(attribute) + 3)
    changed = {**good, "modelDescription.xml": f'{text[:place]} {attribute}="{number}{text[end:]}'.encode()}
    path = _write(tmp_path / "a.fmu", changed)
    try:
        Driver(path).simulate([0.0, 1e-3], {"F": [0.0, 0.0]})
    except FmuError as error:
        assert str(error).startswith("a.fmu")


def test_sizes_in_the_description_are_bounded(good: Content, tmp_path: Path) -> None:
    def many(text: str) -> str:
        return text.replace("<fmiModelDescription", '<fmiModelDescription numberOfEventIndicators="2000000000"', 1)

    if b'fmiVersion="2.0"' in good["modelDescription.xml"]:
        text = good["modelDescription.xml"].decode().replace('numberOfEventIndicators="0"', "")
        changed = _described({**good, "modelDescription.xml": text.encode()}, many)
        _refused(_write(tmp_path / "a.fmu", changed), "HYSTID_FMU_ELEMENTS")


def test_encrypted_and_odd_archives(good: Content, tmp_path: Path) -> None:
    raw = bytearray(_write(tmp_path / "a.fmu", good).read_bytes())
    for signature, offset in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
        place = raw.find(signature)
        raw[place + offset] |= 1
    (tmp_path / "a.fmu").write_bytes(raw)
    _refused(tmp_path / "a.fmu", "encrypted")
    raw = bytearray(_write(tmp_path / "b.fmu", good).read_bytes())
    for signature, offset in ((b"PK\x01\x02", 10), (b"PK\x03\x04", 8)):
        raw[raw.find(signature) + offset] = 99  # a compression that nobody knows
    (tmp_path / "b.fmu").write_bytes(raw)
    _refused(tmp_path / "b.fmu", "damaged")


_OF_FMUS = ("simulate", "regress", "validate good.fmu --against")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
@pytest.mark.parametrize(
    "command",
    [
        "simulate {} --force harmonic:20Hz@80N,1s -o out.csv",
        "regress {}",
        "validate good.fmu --against {} --force harmonic:20Hz@80N,1s -o out",
        "identify {} --mass 0 -o out",
        "diagnose {} --model HystId.Oscillators.Linear -o out",
        "validate {} good.csv -o out",
        "build {}:A -o out.fmu",
        "build {}.mo -o out.fmu",
        "build {}.onnx -o out.fmu",
        "build {}.onnx --target c -o out.c",
        "build HystId.Oscillators.Linear --library {} -o out.fmu",
        "check {}.csv",
        "check {}.mat",
        "check {}.h5 -o out",
        "check good.csv {}.tdms",
        "simulate good.fmu --force {}.csv -o out.csv",
        "simulate good.fmu --force {} -o out.csv",
        "regress good.fmu --reference {}.csv",
        "identify good.csv --mass 0 --holdout {}.csv -o out",
        "identify good.csv --mass 1 --model {}.mo -o out",
        "study grid {}.csv --mass 0 -o out",
        "diagnose good.csv --model {}.mo -o out",
        "diagnose good.csv --model {}.fmu -o out",
        "diagnose good.csv --model HystId.Oscillators.Linear --parameters {}.json -o out",
        "diagnose good.csv --model HystId.Oscillators.Linear --set m=1 --effects {}.mo -o out",
    ],
)
@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_inputs_have_an_end(
    good: Content,
    tmp_path: Path,
    command: str,
    kind: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A pipe without a writer waits for ever; a device gives zeros for ever."""
    if kind == "folder" and ("--library" in command or "--reference" in command):
        pytest.skip("a folder may stand here")
    if b'fmiVersion="3' in good["modelDescription.xml"] and command.partition(" {}")[0] not in _OF_FMUS:
        pytest.skip("the same for both versions")
    monkeypatch.chdir(tmp_path)
    suffix = {"identify": ".csv", "diagnose": ".csv", "build": ".mo"}.get(command.split()[0], ".fmu")
    suffix = ".onnx" if command.startswith("validate {}") else suffix
    if "{}." in command:
        suffix = "." + command.partition("{}.")[2].split()[0]
        command = command.replace("{}" + suffix, "{}")
    path = tmp_path / f"odd{suffix}"
    _write(tmp_path / "good.fmu", good)
    rows = [f"{k / 100},{math.sin(k / 5)},{math.sin(k / 5 - 0.1)}" for k in range(200)]
    (tmp_path / "good.csv").write_text("\n".join(["t [s],F [N],x [m]", *rows]))
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    assert run(command.format(path.name).split()) == 2
    said = capsys.readouterr().err
    assert path.name in said and "internal" not in said and len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists() and not (tmp_path / "out.csv").exists()


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="there is no /proc")
@pytest.mark.parametrize("name", ["status.csv", "status.mo", "status.onnx", "status.fmu"])
def test_files_of_proc_are_empty(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """They are regular and have no length, and some never end (/proc/kmsg)."""
    (path := tmp_path / name).symlink_to("/proc/self/status")
    command = {"csv": "check {}", "fmu": "regress {}"}.get(name[-3:], "build {} -o " + str(tmp_path / "out.fmu"))
    assert run(command.format(path).split()) == 2
    said = capsys.readouterr().err
    assert name in said and "internal" not in said and "Pid" not in said and len(said.splitlines()) == 1


def test_links_in_a_circle_are_no_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (path := tmp_path / "loop.csv").symlink_to("loop.csv")
    for command in ("identify {} --mass 1", "identify good.csv --holdout {} --mass 1", "diagnose {} --model {}"):
        assert run([*command.format(path, path).split(), "-o", str(tmp_path / "out")]) == 2
        assert "internal" not in capsys.readouterr().err


def test_a_version_of_line_ends_is_shown_as_one(good: Content, tmp_path: Path) -> None:
    text = re.sub(rb'fmiVersion="[0-9.]+"', b'fmiVersion="4&#10;hystid: as before"', good["modelDescription.xml"])
    with pytest.raises(FmuError, match=r"FMI version 4\\nhystid: as before is not supported"):
        open_fmu(_write(tmp_path / "model.fmu", {**good, "modelDescription.xml": text}))


def test_a_killed_process_leaves_its_folder_to_the_next(good: Content, tmp_path: Path, temporary: Path) -> None:
    child = os.fork()
    if child == 0:
        _kept = open_fmu(_write(tmp_path / "a.fmu", good))
        os.kill(os.getpid(), 9)
    os.waitpid(child, 0)
    assert len(list(temporary.iterdir())) == 1
    _sweep.cache_clear()
    Driver(_write(tmp_path / "b.fmu", good))


def test_entries_are_read_within_a_budget(good: Content, tmp_path: Path) -> None:
    path = _write(tmp_path / "a.fmu", {**good, "resources/zeros": bytes(4 << 20)})
    assert read_entry(path, "resources/none") is None
    assert len(read_entry(path, "resources/zeros") or b"") == 4 << 20
    with pytest.raises(FmuError, match="more than 1 MB"):
        read_entry(path, "resources/zeros", 1 << 20)


def test_what_is_wrong_in_a_description_is_said(good: Content, tmp_path: Path) -> None:
    """Not "12", not "list index out of range", and not the first of two lines."""
    text = good["modelDescription.xml"].decode()
    wrong = {
        "is not there": re.sub(r"<ModelVariables>.*</ModelVariables>", "<ModelVariables/>", text, flags=re.S),
        "Variable .x.|variable .x.|derivative": re.sub(r'derivative="\d+"', 'derivative="99999"', text),
    }
    if b'fmiVersion="2' in good["modelDescription.xml"]:
        wrong["states -1 event indicators"] = re.sub(r'(numberOfEventIndicators)="\d+"', r'\1="-1"', text)
    for says, changed in wrong.items():
        _refused(_write(tmp_path / "a.fmu", {**good, "modelDescription.xml": changed.encode()}), says)


@pytest.mark.parametrize("token", ["another build", "&#10;%s%n", ""])
def test_the_description_is_that_of_the_library(good: Content, tmp_path: Path, token: str) -> None:
    """The batch entry reads places in a table of numbers: those of another build would be other variables."""
    old = re.search(rb'(guid|instantiationToken)="[^"]*"', good["modelDescription.xml"])
    changed = _described(good, lambda text: text.replace(old[0].decode(), f'{old[1].decode()}="{token}"'))
    with pytest.raises(FmuError, match="could not be instantiated"):
        Driver(_write(tmp_path / "a.fmu", changed))


_MANIFEST = "extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml"


def test_a_manifest_has_no_document_type(good: Content, tmp_path: Path) -> None:
    """Ten lines that stand for 10^9 letters, as in a description."""
    entities = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
    bomb = f'<!DOCTYPE a [<!ENTITY e0 "x">{entities}]><fmiReferences>&e9;</fmiReferences>'
    path = _write(tmp_path / "a.fmu", {**good, _MANIFEST: bomb.encode()})
    with pytest.raises(FmuError, match="document type"):
        regress(path)
    with pytest.raises(FmuError, match="more than 1 MB"):
        regress(_write(tmp_path / "a.fmu", {**good, _MANIFEST: bytes(2 << 20)}))


def test_a_bomb_is_not_kept_by_a_rebuild(
    good: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, temporary: Path
) -> None:
    """The reference of the older FMU was read before anything had looked at its size."""
    monkeypatch.setenv("HYSTID_FMU_UNPACKED_MB", "3")
    bomb = f"{_MANIFEST.rpartition('/')[0]}/zeros"
    path = _write(tmp_path / "a.fmu", {**good, bomb: bytes(4 << 20)})
    before = path.read_bytes()
    read: list[str] = []
    real = zipfile.ZipFile.read
    monkeypatch.setattr(zipfile.ZipFile, "read", lambda self, name, *rest: read.append(name) or real(self, name, *rest))
    with pytest.raises(FmuError, match="unpacks to"):
        build("HystId.Oscillators.Linear", path)
    assert bomb not in read and path.read_bytes() == before


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_damaged_archives_are_one_sentence(good: Content, tmp_path: Path, data: st.DataObject) -> None:
    """Bytes changed, cut out or put in anywhere: what is refused is refused in one sentence, the rest opens."""
    raw = bytearray(_write(tmp_path / "a.fmu", good).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(raw) - 1))
        length = data.draw(st.integers(0, 30))
        raw[place : place + length] = data.draw(st.binary(max_size=30))
    path = tmp_path / "b.fmu"
    path.write_bytes(raw)
    try:
        open_fmu(path)
    except FmuError as error:
        assert str(error).startswith("b.fmu") and "\n" not in str(error)
