"""MAT, HDF5, UFF and TDMS: what each format's own writer stores is what is read."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from hystid.errors import RecordingError, UsageError
from hystid.recording import Recording, read, read_all
from hystid.recording.names import split_header

N, DT = 500, 1e-3
T = np.arange(N) * DT
X = 1e-3 * np.sin(2 * np.pi * 9 * T)
V = 1e-3 * 18 * np.pi * np.cos(2 * np.pi * 9 * T)
F = 40 * V + 5e4 * X


def assert_same(found: Recording) -> None:
    np.testing.assert_allclose(found.t, T, atol=1e-9)
    for name, expected in {"F": F, "x": X}.items():
        np.testing.assert_allclose(found.channel(name), expected, rtol=1e-6, atol=1e-6 * np.max(np.abs(expected)))


# --- MATLAB version 5 -------------------------------------------------------------------------------------------

UNITS = {"t": "s", "F": "kN", "x": "mm"}
TEST = {"t": T, "F": F / 1e3, "x": 1e3 * X}


@pytest.mark.parametrize(
    "variables",
    [
        {**TEST, "units": UNITS},
        {"test": {**TEST, "units": UNITS}},
        {"fs": 1 / DT, "F_kN": F / 1e3, "x_mm": 1e3 * X},
        {"dt": DT, "F": F, "x": X, "note": "rig 4", "matrix": np.eye(3)},
        {"data": {**TEST, "F_unit": "kN", "x_unit": "mm"}},
    ],
    ids=["plain", "struct", "unit in the name", "dt only", "unit beside"],
)
def test_matlab_layouts(tmp_path: Path, variables: dict[str, Any]) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "test.mat", variables)
    assert_same(read(tmp_path / "test.mat"))


def test_a_struct_array_is_several_tests(tmp_path: Path) -> None:
    from scipy.io import savemat

    runs = np.array([{**TEST, "units": UNITS}, {**TEST, "x": 2e3 * X, "units": UNITS}], dtype=object)
    savemat(tmp_path / "runs.mat", {"runs": runs})
    found = read_all([tmp_path / "runs.mat"])
    assert len(found) == 2
    assert_same(found[0])
    np.testing.assert_allclose(found[1].channel("x"), 2 * X, atol=1e-12)
    with pytest.raises(UsageError, match="holds 2 tests"):
        read(tmp_path / "runs.mat")


def test_missing_units_are_taken_as_si_and_said(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "bare.mat", {"t": T, "F": F, "x": X})
    assert len(read(tmp_path / "bare.mat").warnings) == 3


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "not a readable MATLAB file"), (b"MATLAB 5.0 MAT-file" + b"\0" * 300, "MATLAB"), (b"text", "MATLAB")],
)
def test_broken_matlab_files(tmp_path: Path, content: bytes, says: str) -> None:
    (tmp_path / "broken.mat").write_bytes(content)
    with pytest.raises(RecordingError, match=says):
        read(tmp_path / "broken.mat")


def test_matlab_matrices_are_no_channels(tmp_path: Path) -> None:
    for values, says in ((np.c_[F, F], "F holds 500 by 2 numbers"), (F + 1j * X, "F holds complex numbers")):
        savemat(tmp_path / "test.mat", {**TEST, "F": values, "units": UNITS})
        with pytest.raises(RecordingError, match=f"{says}; save the measured values as one vector for each channel"):
            read(tmp_path / "test.mat")


def test_matlab_without_channels_lists_what_is_there(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "other.mat", {"alpha": T, "beta": X})
    with pytest.raises(RecordingError, match="alpha, beta"):
        read(tmp_path / "other.mat")


# --- HDF5 and MATLAB version 7.3 --------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["unit", "Units", "UNIT"])
def test_hdf5_with_unit_attributes(tmp_path: Path, key: str) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "test.h5", "w") as file:
        group = file.create_group("run 1")
        for name, (values, unit) in {"time": (T, "s"), "Force": (F / 1e3, "kN"), "x": (1e3 * X, "mm")}.items():
            group[name] = values
            group[name].attrs[key] = unit
    assert_same(read(tmp_path / "test.h5"))


def test_hdf5_with_a_sample_rate(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "test.hdf5", "w") as file:
        file.attrs["fs"] = 1 / DT
        file["F [N]"], file["x [mm]"] = F, 1e3 * X
    found = read(tmp_path / "test.hdf5")
    assert_same(found)
    assert "sample rate" in found.origin["t"]


def test_matlab_7_3(tmp_path: Path) -> None:
    """MATLAB's own conventions, as its documentation states them: row vectors stored transposed, texts as uint16."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "test.mat", "w", userblock_size=512) as file:
        test = file.create_group("test")
        for name, values in TEST.items():
            test.create_dataset(name, data=values[:, None]).attrs["MATLAB_class"] = np.bytes_("double")
        units = test.create_group("units")
        for name, text in UNITS.items():
            codes = np.array([[ord(letter)] for letter in text], dtype=np.uint16)
            units.create_dataset(name, data=codes).attrs["MATLAB_class"] = np.bytes_("char")
    assert_same(read(tmp_path / "test.mat"))


def test_matlab_7_3_struct_array(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "runs.mat", "w", userblock_size=512) as file:
        hidden, runs = file.create_group("#refs#"), file.create_group("runs")
        for name, values in {"t": T, "F": F, "x": X}.items():
            refs = [hidden.create_dataset(f"{name}{k}", data=(values[:, None])).ref for k in range(2)]
            runs.create_dataset(name, data=np.array([refs], dtype=h5py.ref_dtype))
    found = read_all([tmp_path / "runs.mat"])
    assert len(found) == 2
    assert_same(found[1])


def test_broken_hdf5(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    (tmp_path / "broken.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + b"x" * 100)
    with pytest.raises(RecordingError, match="not a readable HDF5 file"):
        read(tmp_path / "broken.h5")


# --- UFF and TDMS ------------------------------------------------------------------------------------------------


def _response(pyuff: Any, kind: int, label: str, values: Any, time: Any) -> dict[str, Any]:
    """A data set 58."""
    # every exponent and label has to be given, or the writer fails on its own None
    axes = ("abscissa", "ordinate", "orddenom", "z_axis")
    exponents = {f"{axis}_{kind}_unit_exp": 0 for axis in axes for kind in ("len", "force", "temp")}
    names = {f"{axis}_axis_units_lab": "NONE" for axis in axes} | {f"id{k}": "test" for k in range(1, 6)}
    numbers = dict.fromkeys(("ver_num", "load_case_id", "orddenom_spec_data_type", "z_axis_spec_data_type"), 0)
    given = {**exponents, **names, **numbers, "ordinate_spec_data_type": kind, "ordinate_axis_units_lab": label}
    made: dict[str, Any] = pyuff.prepare_58(
        binary=0, func_type=1, rsp_ent_name="NONE", rsp_node=1, rsp_dir=1, ref_ent_name="NONE", ref_node=0,
        ref_dir=0, ord_data_type=6 if np.iscomplexobj(values) else 4, num_pts=N, abscissa_spacing=1,
        abscissa_min=float(time[0]), abscissa_inc=float(time[1] - time[0]),
        z_axis_value=0.0, abscissa_spec_data_type=17, data=values, x=time, return_full_dict=True, **given,
    )  # fmt: skip
    return made


def test_universal_file(tmp_path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    file = pyuff.UFF(str(tmp_path / "test.uff"))
    file.write_sets(_response(pyuff, 13, "N", F, T), "overwrite")
    file.write_sets(_response(pyuff, 8, "mm", 1e3 * X, T), "add")
    assert_same(read(tmp_path / "test.uff"))


def test_universal_file_without_time_responses(tmp_path: Path) -> None:
    pytest.importorskip("pyuff")
    (tmp_path / "broken.unv").write_text("nothing of the kind\n")
    with pytest.raises(RecordingError, match=r"broken\.unv"):
        read(tmp_path / "broken.unv")


def test_tdms(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    properties = {"wf_increment": DT, "wf_samples": N}
    channels = [
        nptdms.ChannelObject("run", "Force", F / 1e3, {**properties, "unit_string": "kN"}),
        nptdms.ChannelObject("run", "x [mm]", 1e3 * X, properties),
    ]
    with nptdms.TdmsWriter(tmp_path / "test.tdms") as writer:
        writer.write_segment(channels)
    assert_same(read(tmp_path / "test.tdms"))


def test_time_stamps_of_tdms(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    stamps = np.datetime64("2024-03-05T23:59:59.800000") + np.rint(T * 1e6).astype("timedelta64[us]")
    columns = {"Time": stamps, "Force [N]": F, "x [mm]": 1e3 * X}
    with nptdms.TdmsWriter(tmp_path / "test.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject("run", name, values) for name, values in columns.items()])
    assert_same(read(tmp_path / "test.tdms"))


def test_broken_tdms(tmp_path: Path) -> None:
    pytest.importorskip("nptdms")
    (tmp_path / "broken.tdms").write_bytes(b"TDSx" + b"\0" * 50)
    with pytest.raises(RecordingError, match=r"broken\.tdms"):
        read(tmp_path / "broken.tdms")


@pytest.mark.parametrize(
    ("suffix", "package", "extra"), [("h5", "h5py", "hdf5"), ("uff", "pyuff", "uff"), ("tdms", "nptdms", "tdms")]
)
def test_a_missing_package_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, package: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / f"test.{suffix}").write_bytes(b"\x89HDF\r\n\x1a\n")
    with pytest.raises(RecordingError, match=rf"hystid\[{extra}\]"):
        read(tmp_path / f"test.{suffix}")


# --- MDF and Parquet --------------------------------------------------------------------------------------------


def test_mdf(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    file = asammdf.MDF(version="4.10")
    file.append(
        [asammdf.Signal(F / 1e3, T, name="Kraft", unit="kN"), asammdf.Signal(1e3 * X, T, name="Weg", unit="mm")]
    )
    file.save(tmp_path / "test.mf4")
    assert_same(read(tmp_path / "test.mf4"))


def test_parquet(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    units = {"t": "s", "Force": "kN", "x [mm]": ""}
    fields = [pa.field(name, pa.float64(), metadata={"unit": unit} if unit else None) for name, unit in units.items()]
    parquet.write_table(pa.table([T, F / 1e3, 1e3 * X], schema=pa.schema(fields)), tmp_path / "test.parquet")
    assert_same(read(tmp_path / "test.parquet"))
    parquet.write_table(pa.table({"t": [str(t) for t in T], "F": [str(f) for f in F]}), tmp_path / "text.parquet")
    with pytest.raises(RecordingError, match=r"no column holds numbers \(the columns are t, F\)"):
        read(tmp_path / "text.parquet")


# --- Text as loggers write it -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("head", "encoding"),
    [
        ("Prüfstand 7\nBediener: Müller\n\nZeit in s;Kraft in N;Weg in mm\n", "cp1252"),
        ("Prüfung\nZeit;Kraft;Weg\ns;N;mm\n", "utf-16"),
        ("Zeit [s];Kraftaufnehmer [N];Wegsensor [mm]\n", "utf-8"),
        ("Temps (s);Force (N);Déplacement (mm)\n", "cp1252"),
        ("Tiempo [s];Fuerza [N];Desplazamiento [mm]\n", "utf-8"),
        ("Tid i s;Kraft i N;Udbøjning i mm\n", "cp1252"),
        ("Tid;Kraft;Förskjutning\ns;N;mm\n", "utf-8"),
        ("時間 [s];荷重 [N];変位 [mm]\n", "utf-8"),
        ("時間（ｓ）;荷重（Ｎ）;変位（ｍｍ）\n", "utf-8"),
        ("CH=3\tLL=100\n\nZeit  1 - Standardmessrate;Kraft;Weg\ns;N;mm\n", "cp1252"),
        ("Time(S);Force(n);Disp(MM)\n", "utf-8"),
    ],
    ids=[
        "preamble",
        "second row of units",
        "sensors",
        "French",
        "Spanish",
        "Danish",
        "Swedish",
        "Japanese",
        "wide",
        "catman",
        "capitals",
    ],
)
def test_text_of_loggers(tmp_path: Path, head: str, encoding: str) -> None:
    """Nine digits, decimal commas, a preamble, and the words of six languages."""
    rows = [";".join(f"{value:.9g}".replace(".", ",") for value in row) for row in zip(T, F, 1e3 * X, strict=True)]
    (tmp_path / "logger.csv").write_bytes((head + "\n".join(rows)).encode(encoding))
    assert_same(read(tmp_path / "logger.csv"))


def test_lost_rows_are_bridged_and_told(tmp_path: Path) -> None:
    """Three of 500 rows, at two places; more than one in a hundred would be refused."""
    kept = np.delete(np.arange(N), [200, 201, 400])
    rows = [f"{T[k]},{F[k]},{1e3 * X[k]}" for k in kept]
    (tmp_path / "lost.csv").write_text("t [s],F [N],x [mm]\n" + "\n".join(rows))
    found = read(tmp_path / "lost.csv")
    assert len(found) == N and any("3 samples missing at 2 places" in text for text in found.warnings)
    assert np.max(np.abs(found.channel("x") - X)) < (2 * np.pi * 9 * 1.5 * DT) ** 2 / 2 * 1e-3  # a chord of three steps


def _written(path: Path, head: str, cells: list[list[str]], mark: str) -> Path:
    path.write_text(head + "\n" + "\n".join(mark.join(row) for row in cells) + "\n", encoding="utf-8")
    return path


def _digits(*columns: np.ndarray[Any, Any]) -> list[list[str]]:
    return [[f"{value:.9g}" for value in row] for row in zip(*columns, strict=True)]


_MIDNIGHT = np.datetime64("2024-03-05T23:59:59.800000")
_HOUR_LATER = [str(stamp) for stamp in _MIDNIGHT + np.rint((T + 3600) * 1e6).astype("timedelta64[us]")]
_DATES = [str(stamp) for stamp in _MIDNIGHT + np.rint(T * 1e6).astype("timedelta64[us]")]


@pytest.mark.parametrize(
    "stamps",
    [
        _DATES,
        [f"{stamp.replace('T', ' ')[:-3]}Z" for stamp in _DATES],
        [stamp[11:] for stamp in _DATES],
        [f"5.3.2024 {stamp[11:].replace('.', ',')}" for stamp in _DATES],
        [f"3/5/2024 {'12' if s[11:13] == '00' else '11'}{s[13:]} {'AM' if s[11:13] == '00' else 'PM'}" for s in _DATES],
        [stamp[14:] for stamp in _DATES],
        [stamp.replace("-", "").replace(":", "") + "+0100" for stamp in _DATES],
        [f"0{stamp[9]}-Mar-2024 {stamp[11:]} UTC" for stamp in _DATES],
        [stamp[11:19] + f":{stamp[20:23]}" for stamp in _DATES],
        [
            f"{a}+01:00" if k < len(T) // 2 else f"{b}+02:00"
            for k, (a, b) in enumerate(zip(_DATES, _HOUR_LATER, strict=True))
        ],
    ],
    ids=[
        "ISO",
        "UTC",
        "time of day",
        "German",
        "American",
        "minutes",
        "basic ISO",
        "month",
        "milliseconds",
        "summer time begins",
    ],
)
def test_times_of_day_are_seconds(tmp_path: Path, stamps: list[str]) -> None:
    """Through midnight, with and without a date: microseconds at least, 1e-6 of a step below."""
    rows = [[stamp, *rest] for stamp, rest in zip(stamps, _digits(F, 1e3 * X), strict=True)]
    found = read(_written(tmp_path / "clock.csv", "Zeit;Kraft [N];Weg [mm]", rows, ";"))
    np.testing.assert_allclose(found.t - found.t[0], T, atol=2e-9)
    np.testing.assert_allclose(found.channel("x"), X, rtol=1e-6, atol=1e-9)
    assert not found.warnings  # its unit is known


def test_a_clock_yields_to_a_column_of_seconds(tmp_path: Path) -> None:
    rows = [[stamp, *rest] for stamp, rest in zip(_DATES, _digits(T, F, 1e3 * X), strict=True)]
    assert_same(read(_written(tmp_path / "two.csv", "Timestamp,Time (s),F [N],x [mm]", rows, ",")))


@pytest.mark.parametrize(
    ("head", "cells", "mark"),
    [
        ("t [s];F [N];;x [mm];Bemerkung", [[t, f, "", x, ""] for t, f, x in _digits(T, F, 1e3 * X)], ";"),
        ("t [s],F [N],x [mm],Status", [[*row, "ok"] for row in _digits(T, F, 1e3 * X)], ","),
        ("X_Value\tForce\tDisp\tComment", _digits(T, F, X), "\t"),
        ("Y_Unit_Label\tN\tmm\nX_Value\tForce\tDisp\tComment", _digits(T, F, 1e3 * X), "\t"),
        ("Nr;Zeit;Kraft;Weg\nEinheit;s;kN;mm", [["7", *row] for row in _digits(T, F / 1e3, 1e3 * X)], ";"),
        ("t [s]|F [N]|x [mm]", _digits(T, F, 1e3 * X), "|"),
        ("Time (s),Load Cell 1 (N),LVDT 1 (mm)", _digits(T, F, 1e3 * X), ","),
        ("t [s] F [N] x [m]", [[f"{u:.9E}".replace("E", "D") for u in row] for row in zip(T, F, X, strict=True)], " "),
    ],
    ids=["empty columns", "words", "comments", "LabVIEW", "row of units", "bars", "numbered", "Fortran"],
)
def test_tables_of_loggers(tmp_path: Path, head: str, cells: list[list[str]], mark: str) -> None:
    assert_same(read(_written(tmp_path / "test.txt", head, cells, mark)))


def test_labview_measurement_files(tmp_path: Path) -> None:
    """Seconds without a word; every other unit is asked for, for LabVIEW writes volts where none is set."""
    rows = _digits(T, F, 1e3 * X)
    units, names = "Y_Unit_Label\tN\tmm\t\n", "X_Value\tForce\tDisp\tComment"
    found = read(_written(tmp_path / "units.lvm", units + names, rows, "\t"))
    assert_same(found)
    assert found.warnings == ()
    bare = [["", *row[1:]] for row in rows]  # X_Columns: No
    assert_same(read(_written(tmp_path / "no.lvm", f"{units}Delta_X\t{DT}\t{DT}\t\n{names}", bare, "\t")))
    silent = _written(tmp_path / "silent.lvm", names, rows, "\t")
    with pytest.raises(RecordingError, match="channel F: column Force has no unit, and LabVIEW writes volts where"):
        read(silent)
    assert_same(read(silent, units={"F": "N", "x": "mm"}))
    volts = _written(tmp_path / "volts.lvm", f"Y_Unit_Label\tVolts\tmm\t\n{names}", rows, "\t")
    with pytest.raises(RecordingError, match="channel F: F is a voltage"):
        read(volts)
    parts = [*rows[:250], ["Channels", "2", ""], *rows[250:]]
    with pytest.raises(RecordingError, match="a second table begins with 'Channels"):
        read(_written(tmp_path / "parts.lvm", units + names, parts, "\t"))


@pytest.mark.parametrize("marker", ["9.9E+37", "-9999", "9999999", "3.40282e38"])
def test_markers_of_loggers_are_no_measurements(tmp_path: Path, marker: str) -> None:
    """What stands where nothing was measured counts as a lost row; an extreme of all nines stays."""
    rows = _digits(T, F, 1e3 * X)
    rows[200][2] = rows[201][2] = marker
    found = read(_written(tmp_path / "marked.csv", "t [s],F [N],x [mm]", rows, ","))
    assert any("2 of 500 samples hold" in text for text in found.warnings)
    assert np.max(np.abs(found.channel("x") - X)) < (2 * np.pi * 9 * 1.5 * DT) ** 2 / 2 * 1e-3  # a chord of three steps
    size = 999 / np.max(np.abs(X))
    full = read(_written(tmp_path / "full.csv", "t [s],F [N],x [mm]", _digits(T, F, size * X), ","))
    np.testing.assert_allclose(full.channel("x"), size * X / 1e3, rtol=1e-6, atol=1e-9)


def test_a_minus_of_a_word_processor(tmp_path: Path) -> None:
    rows = [[cell.replace("-", "\N{MINUS SIGN}") for cell in row] for row in _digits(T, F, 1e3 * X)]
    assert_same(read(_written(tmp_path / "minus.csv", "t [s];F [N];x [mm]", rows, ";")))


def test_units_below_the_samples(tmp_path: Path) -> None:
    rows = [*_digits(T, F / 1e3, 1e3 * X), ["s", "kN", "mm"]]
    assert_same(read(_written(tmp_path / "below.csv", "t;F;x", rows, ";")))


def _refused(path: Path, says: str) -> None:
    with pytest.raises(RecordingError, match=says):
        read(path)


def test_counts_of_a_converter_are_no_units(tmp_path: Path) -> None:
    """Whole numbers without a unit, or with a factor beside them, are asked about; nobody knows what was applied."""
    h5py, nptdms = pytest.importorskip("h5py"), pytest.importorskip("nptdms")
    counts = np.round(F / np.max(np.abs(F)) * 3e4).astype(np.int16)
    path = tmp_path / "test.mat"
    savemat(path, {"t": T, "F": counts, "x": X, "x_unit": "m"})
    _refused(path, "column F has no unit, and holds whole numbers, as a converter counts; give --unit F=N")
    assert np.max(read(path, units={"F": "N"}).channel("F")) > 2e4
    savemat(path, {"t": T, "F": np.round(F), "x": X, "units": {"F": "N", "x": "m"}})
    assert read(path).warnings[0].count("column t has no unit") == 1  # whole numbers in doubles are no counts
    for scale in ({"F_scale": 0.01}, {"scale": {"F": 0.01}}, {"F_gain": 20.0}):
        savemat(path, {"t": T, "F": counts, "x": X, "units": UNITS, **scale})
        _refused(path, "stands beside F, and is not applied; write F in its unit")
    savemat(path, {**TEST, "units": UNITS, "F_scale": 1.0, "gain": 3.0})
    assert_same(read(path))
    with h5py.File(tmp_path / "test.h5", "w") as file:
        file["t"], file["x"], file["F"] = T, X, counts
        file["F"].attrs.update({"unit": "N", "scale_factor": 0.01})
    _refused(tmp_path / "test.h5", "scale_factor = 0.01 stands beside F")
    with nptdms.TdmsWriter(tmp_path / "test.tdms") as writer:
        channels = [nptdms.ChannelObject("run", name, u, {"wf_increment": DT}) for name, u in (("F", counts), ("x", X))]
        writer.write_segment(channels)
    _refused(tmp_path / "test.tdms", "column F has no unit, and holds whole numbers")


@pytest.mark.parametrize(
    ("word", "encoding"), [("时间 [s],载荷 [N],位移 [mm]", "gbk"), ("시간 [s],하중 [N],변위 [mm]", "cp949")]
)
def test_code_pages_of_asia(tmp_path: Path, word: str, encoding: str) -> None:
    rows = "\n".join(",".join(row) for row in _digits(T, F, 1e3 * X))
    (tmp_path / "page.csv").write_bytes(f"{word}\n{rows}\n".encode(encoding))
    assert_same(read(tmp_path / "page.csv"))


@pytest.mark.parametrize(
    ("head", "cells", "says"),
    [
        ("t [s];F [N];x [m]\nscale;0.01;1e-7", _digits(T, F * 100, X * 1e7), "line 2: 'scale 0.01 1e-7' scales the"),
        ("Zeit;F [N];x [m]", [[f"{45356.5 + t / 86400:.12f}", f"{f}", f"{x}"] for t, f, x in zip(T, F, X, strict=True)],
         "as a count of days in a spreadsheet does; give --unit t=d"),
        ("t [s];F [N];x [m]", [[f"{t:.2f}", f"{f}", f"{x}"] for t, f, x in zip(T, F, X, strict=True)],
         "written with too few digits"),
        ("t [s];F [mN];x [m]", [[f"{t}", f"{1e4 * f:,.3f}", f"{x}"] for t, f, x in zip(T, F, X, strict=True)],
         "no marks between thousands"),
        ("t [s];F [mN];x [m]", [[f"{t}", f"{1e3 * f:,.0f}".replace(",", "."), f"{x}"]
                                for t, f, x in zip(T, F, X, strict=True)], "channel F: '.*' beside whole numbers"),
        ("t [s];F [N];x [m];x [m]", _digits(T, F, X, X), "two columns are named 'x'; rename one of them"),
        ("t [s];F [N];x [m]", [*_digits(T, F, X), ["t [s]", "F [N]", "x [m]"], *_digits(T, F, X)],
         "line 502, sample 500, channel t: a second table begins with"),
        ("t [s];F [LSB];x [m]", _digits(T, F, X), "unit 'LSB' is not known"),
        ("t;F;x\nunit;LSB;m", _digits(T, F, X), "unit 'LSB' is not known"),
        ("F [N];x [m]", _digits(F, X), "or write 'sample rate: ... Hz' above the header"),
        ("t;F [N];x [m]", [[f"{1.79e12 + 1e3 * t:.3f}", f"{f}", f"{x}"] for t, f, x in zip(T, F, X, strict=True)],
         "a count of ms since 1970 does; give --unit t=ms"),
        ("t;F;x", [[f"{t} s", f"{f} N", f"{x} m"] for t, f, x in zip(T, F, X, strict=True)],
         r"line 501: '0\.499 s' holds more than a number; write units into the header"),
    ],
    ids=["scale", "days", "digits", "thousands", "points", "namesakes",
         "second table", "counts", "row of counts", "clock", "ticks", "units in cells"],
)  # fmt: skip
def test_tables_that_would_be_misread_are_refused(tmp_path: Path, head: str, cells: list[list[str]], says: str) -> None:
    path = _written(tmp_path / "bad.csv", head, cells, ";")
    with pytest.raises(RecordingError, match=says):
        read(path)


def test_channels_are_chosen_where_a_binary_file_names_none(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "daq.mat", {"ai0": F, "ai1": X, "fs": 1 / DT})
    with pytest.raises(RecordingError, match="it has ai0, ai1; name a column"):
        read(tmp_path / "daq.mat")
    assert_same(read(tmp_path / "daq.mat", names={"F": "ai0", "x": "ai1"}))


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("Beschleunigung in m/s2", "Beschleunigung", "m/s2"),
        ("a / m/s²", "a", "m/s²"),
        ("v / (m/s)", "v", "m/s"),
        ("Drehzahl in 1/min", "Drehzahl", "1/min"),
        ("Kraft/N", "Kraft", "N"),
        ("Beschl. in g", "Beschl.", "g"),
        ("t_pseudo", "t_pseudo", None),
    ],
)
def test_units_with_strokes_in_spoken_headers(header: str, name: str, unit: str | None) -> None:
    """A stroke parts a name from its unit, and stands in units as well."""
    assert split_header(header) == (name, unit)


def test_a_remark_in_the_first_row_keeps_its_sample(tmp_path: Path) -> None:
    rows = [f"{k / 1000:.3f},{math.sin(0.05 * k):.6f},{1e-3 * math.cos(0.05 * k):.9f}" for k in range(300)]
    remarks = {0: "start", 1: "shaker on", 150: "door open"}
    lines = ["t [s],F [N],x [m],remark", *(f"{row},{remarks.get(k, '')}" for k, row in enumerate(rows))]
    (tmp_path / "remarks.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert len(read(tmp_path / "remarks.csv")) == 300


@pytest.mark.parametrize("line", ["# fs = 1000 Hz", "fs: 1 kHz", "Sampling_Rate;1000"])
def test_short_words_for_the_sample_rate_are_read(tmp_path: Path, line: str) -> None:
    rows = [f"{math.sin(0.05 * k):.6f};{1e-3 * math.cos(0.05 * k):.9f}" for k in range(300)]
    (tmp_path / "rate.csv").write_text("\n".join([line, "F [N];x [m]", *rows]) + "\n", encoding="utf-8")
    assert read(tmp_path / "rate.csv").sample_rate == pytest.approx(1000)


@pytest.mark.parametrize(
    ("other", "spans"),
    [({"wf_increment": 2 * DT}, "0 to "), ({"wf_increment": DT, "wf_start_offset": 0.05}, "0.05 to ")],
)
def test_waveforms_of_another_clock_are_refused(tmp_path: Path, other: dict[str, float], spans: str) -> None:
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "test.tdms") as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("run", "F [N]", F, {"wf_increment": DT, "wf_start_offset": 0.0}),
                nptdms.ChannelObject("run", "x [m]", X, other),
            ]
        )
    _refused(tmp_path / "test.tdms", f"x .m. is sampled at other times .{spans}.* than F .N.")


@pytest.mark.parametrize(
    ("time", "x", "says"),
    [(T + 0.05, X, "sampled at other times"), (2 * T, X, "sampled at other times"), (T, X + 1j, "complex numbers")],
)
def test_universal_files_of_another_clock_are_refused(tmp_path: Path, time: Any, x: Any, says: str) -> None:
    pyuff = pytest.importorskip("pyuff")
    file = pyuff.UFF(str(tmp_path / "test.uff"))
    file.write_sets(_response(pyuff, 13, "N", F, T), "overwrite")
    file.write_sets(_response(pyuff, 8, "m", x, time), "add")
    _refused(tmp_path / "test.uff", f"x .*{says}")


def test_no_value_is_made_up_beyond_the_ends_of_a_channel(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    file = asammdf.MDF(version="4.10")
    file.append([asammdf.Signal(F, T, name="F", unit="N")])
    file.append([asammdf.Signal(X[40:-20], T[40:-20], name="x", unit="m")])
    file.save(tmp_path / "test.mf4")
    found = read(tmp_path / "test.mf4")
    assert found.F is not None and found.x is not None
    np.testing.assert_allclose(found.t, T[40:-20])
    np.testing.assert_allclose([found.F, found.x], [F[40:-20], X[40:-20]])
    file = asammdf.MDF(version="4.10")
    file.append([asammdf.Signal(F, T, name="F", unit="N")])
    file.append([asammdf.Signal(X, T + 100, name="x", unit="m")])
    file.save(tmp_path / "apart.mf4")
    _refused(tmp_path / "apart.mf4", "F ends at .* s, and x begins at 100 s")
