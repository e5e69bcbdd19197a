"""Files of other formats as laboratories write them: what is beside the values changes none of them in silence."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from hystid.errors import RecordingError
from hystid.recording import Recording, read

N, DT = 400, 1e-3
T = np.arange(N) * DT
X = 1e-3 * np.sin(2 * np.pi * 9 * T)
F = 0.72 * np.pi * np.cos(2 * np.pi * 9 * T) + 5e4 * X


def _same(found: Recording, tolerance: float = 1e-12) -> None:
    for name, expected in {"F": F, "x": X}.items():
        np.testing.assert_allclose(found.channel(name), expected, rtol=0, atol=tolerance * np.max(np.abs(expected)))


def _refused(path: Path, says: str) -> None:
    with pytest.raises(RecordingError, match=says):
        read(path)


def _hdf5(path: Path, **sets: tuple[Any, dict[str, Any]]) -> Path:
    with pytest.importorskip("h5py").File(path, "w") as file:
        file.attrs["fs"] = 1 / DT
        for name, (values, attributes) in sets.items():
            file[name] = values
            file[name].attrs.update(attributes)
    return path


def test_matrices_of_hdf5_are_no_channels(tmp_path: Path) -> None:
    """Several tests side by side were one recording, sample by sample in turn; a column of its own is a channel."""
    path = tmp_path / "test.h5"
    for shape in ((N // 2, 2), (2, N // 2)):
        _refused(_hdf5(path, F=(F.reshape(shape), {}), x=(X.reshape(shape), {})), f"F holds {shape[0]} by {shape[1]} n")
    _same(read(_hdf5(path, F=(F[:, None], {"unit": "N"}), x=(X[None, :], {"unit": "m"}))))
    _hdf5(path, **{"R": (np.eye(3), {}), "run/t": (T, {}), "run/F": (F, {}), "run/x": (X, {})})
    _same(read(path))  # a matrix beside the tests, as of a rotation, is none of theirs


def test_units_of_hdf5_in_a_code_page_of_windows(tmp_path: Path) -> None:
    unit = np.bytes_("µm".encode("cp1252"))
    _same(read(_hdf5(tmp_path / "test.h5", F=(F, {"unit": "N"}), x=(1e6 * X, {"unit": unit}))))


def test_an_offset_beside_a_channel_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "test.h5"
    _refused(_hdf5(path, F=(F, {"unit": "N", "add_offset": 5.0}), x=(X, {})), "add_offset = 5 stands beside F")
    _same(read(_hdf5(path, F=(F, {"unit": "N", "add_offset": 0.0}), x=(X, {}))))


def test_units_of_matlab_as_a_list_are_refused(tmp_path: Path) -> None:
    units = np.array(["s", "kN", "mm"], dtype=object)
    savemat(tmp_path / "test.mat", {"t": T, "F": F / 1e3, "x": 1e3 * X, "units": units})
    _refused(tmp_path / "test.mat", r"units is a list \(s, kN, mm\)")


def test_the_index_beside_a_tdms_file_is_not_asked(tmp_path: Path) -> None:
    """It may be that of another recording."""
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "test.tdms"
    for units, index in ({"F": "kN", "x": "m"}, True), ({"F": "N", "x": "mm"}, False):
        channels = [
            nptdms.ChannelObject("run", name, values, {"wf_increment": DT, "unit_string": units[name]})
            for name, values in {"F": F, "x": 1e3 * X}.items()
        ]
        with nptdms.TdmsWriter(str(path), index_file=index) as writer:
            writer.write_segment(channels)
    assert path.with_suffix(".tdms_index").exists()
    _same(read(path))


def test_a_temperature_called_t_is_no_time(tmp_path: Path) -> None:
    """Of a group of slow channels it made a test without time and force."""
    nptdms = pytest.importorskip("nptdms")
    groups = {"fast": (DT, {"F": (F, "N"), "x": (X, "m")}), "slow": (0.1, {"T": (np.full(4, 21.5), "degC")})}
    with nptdms.TdmsWriter(tmp_path / "test.tdms") as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject(group, name, values, {"wf_increment": step, "unit_string": unit})
                for group, (step, channels) in groups.items()
                for name, (values, unit) in channels.items()
            ]
        )
    _same(read(tmp_path / "test.tdms"))


def _parquet(path: Path, meta: dict[str, dict[str | bytes, str | bytes]], names: list[str], *columns: Any) -> Path:
    pa = pytest.importorskip("pyarrow")
    arrays = [pa.array(column) for column in columns]
    fields = [pa.field(name, array.type, metadata=meta.get(name)) for name, array in zip(names, arrays, strict=True)]
    pytest.importorskip("pyarrow.parquet").write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), path)
    return path


def test_parquet_of_other_writers(tmp_path: Path) -> None:
    path, names = tmp_path / "test.parquet", ["t [s]", "F", "x"]
    meta: dict[str, dict[str | bytes, str | bytes]] = {"F": {"Unit": "kN"}, "x": {b"units": "µm".encode("cp1252")}}
    _same(read(_parquet(path, meta, names, T, F / 1e3, 1e6 * X)))
    decimals = [Decimal(f"{force:.9f}") for force in F]
    _same(read(_parquet(path, {}, ["t [s]", "F [N]", "x [m]"], T, decimals, X)), 1e-9)
    _parquet(path, {}, ["t [s]", "F [N]", "x [m]", "x [m]"], T, F, X, X)
    _refused(path, "two columns are named 'x'")


def test_units_of_a_universal_file_in_its_data_set_164(tmp_path: Path) -> None:
    """Responses without a label are in the units of the file, of which the factors of data set 164 say the size."""
    pyuff = pytest.importorskip("pyuff")
    path = tmp_path / "test.uff"
    inch, pound = 0.0254, 4.4482216152605

    def write(label: str, x: Any, *before: dict[str, Any]) -> Path:
        common = {"type": 58, "func_type": 1, "x": T, "abscissa_spacing": 1, "binary": 0, "rsp_ent_name": "NONE"}
        common |= {
            "rsp_node": 1,
            "rsp_dir": 1,
            "ref_ent_name": "NONE",
            "ref_node": 0,
            "ref_dir": 0,
            "z_axis_value": 0.0,
        }
        common |= {"num_pts": N, "abscissa_min": 0.0, "abscissa_inc": DT, "abscissa_spec_data_type": 17}
        common |= {"ord_data_type": 4, "orddenom_spec_data_type": 0}
        force = {"ordinate_spec_data_type": 13, "data": F / pound, "ordinate_axis_units_lab": "NONE"}
        motion = {"ordinate_spec_data_type": 8, "data": x, "ordinate_axis_units_lab": label}
        pyuff.UFF(str(path)).write_sets([*before, common | force, common | motion], "overwrite")
        return path

    units = {"type": 164, "units_code": 7, "units_description": "Inch (pound f)", "temp_mode": 1, "temp": 1.8}
    units |= {"length": 1 / inch, "force": 1 / pound, "temp_offset": 459.67}
    _same(read(write("NONE", X / inch, units)), 1e-9)
    _same(read(write("mm", 1e3 * X, units)), 1e-9)
    _refused(write("NONE", X / inch, units | {"length": 0.0}), "data set 164 gives a length of 0 units")


def test_a_problem_of_one_test_in_a_file_says_of_which(tmp_path: Path) -> None:
    with pytest.importorskip("h5py").File(tmp_path / "test.h5", "w") as file:
        for group, channels in {"fast": {"t": T, "F": F, "x": X}, "slow": {"t": T, "x": X}}.items():
            for name, values in channels.items():
                file[f"{group}/{name}"] = values
    _refused(tmp_path / "test.h5", r"^test\.h5, test slow, channel F: there is no channel F")


def test_counts_of_mdf_and_parquet_are_no_newtons(tmp_path: Path) -> None:
    """Whole numbers without a unit are asked about, as in HDF5; a conversion in the file is carried out."""
    asammdf = pytest.importorskip("asammdf")
    counts = np.round(F * 10).astype(np.int16)
    says = "column F has no unit, and holds whole numbers, as a converter counts; give --unit F=N"
    for unit, conversion, refused in (("", None, True), ("N", {"a": 0.1, "b": 0.0}, False)):
        file = asammdf.MDF(version="4.10")
        force = asammdf.Signal(counts, T, name="F", unit=unit, conversion=conversion)
        file.append([force, asammdf.Signal(X, T, name="x", unit="m")])
        file.save(tmp_path / "test.mf4", overwrite=True)
        if refused:
            _refused(tmp_path / "test.mf4", says)
        else:
            _same(read(tmp_path / "test.mf4"), 0.06 / np.max(np.abs(F)))  # half a count of 0.1 N
    _refused(_parquet(tmp_path / "test.parquet", {}, ["t [s]", "F", "x [m]"], T, counts, X), says)
