"""Binary recordings that are damaged, endless or made to deceive: one sentence each, in a process of its own."""

from __future__ import annotations

import functools
import io
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from hystid.errors import RecordingError
from hystid.recording import read, read_all

N = 200
T = np.arange(N) / 1000.0
X = 1e-3 * np.sin(2 * np.pi * (5 + 40 * T) * T)
F = 9000.0 * X + 6.0 * np.gradient(X, T)


def _mat(folder: Path) -> Path:
    savemat(folder / "a.mat", {"t": T, "F": F, "x": X, "units": {"t": "s", "F": "N", "x": "m"}}, do_compression=True)
    return folder / "a.mat"


def _hdf5(folder: Path) -> Path:
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    with h5py.File(folder / "a.h5", "w") as file:
        for name, values, unit in (("t", T, "s"), ("F", F, "N"), ("x", X, "m")):
            file.create_dataset(name, data=values, compression="gzip").attrs["unit"] = unit
    return folder / "a.h5"


def _tdms(folder: Path) -> Path:
    nptdms = pytest.importorskip("nptdms", reason="needs the extra tdms")
    columns = (("t", "s", T), ("F", "N", F), ("x", "m", X))
    with nptdms.TdmsWriter(folder / "a.tdms") as writer:
        writer.write_segment(
            [nptdms.ChannelObject("test", name, v, properties={"unit_string": unit}) for name, unit, v in columns]
        )
    return folder / "a.tdms"


def _uff(folder: Path) -> Path:
    pyuff = pytest.importorskip("pyuff", reason="needs the extra uff")
    file = pyuff.UFF(str(folder / "a.uff"))
    axes = ("abscissa", "ordinate", "orddenom", "z_axis")
    given = {f"{axis}_{kind}_unit_exp": 0 for axis in axes for kind in ("len", "force", "temp")}
    given |= {f"{axis}_axis_units_lab": "NONE" for axis in axes} | {f"id{k}": "test" for k in range(1, 6)}
    given |= dict.fromkeys(("ver_num", "load_case_id", "orddenom_spec_data_type", "z_axis_spec_data_type"), 0)
    for number, (values, kind) in enumerate(((F, 13), (X, 8)), start=1):
        data = pyuff.prepare_58(
            binary=0, func_type=1, rsp_ent_name="NONE", rsp_node=number, rsp_dir=1, ref_ent_name="NONE", ref_node=0,
            ref_dir=0, ord_data_type=4, num_pts=N, abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=1e-3,
            z_axis_value=0.0, abscissa_spec_data_type=17, ordinate_spec_data_type=kind, data=values, x=T,
            return_full_dict=True, **given,
        )  # fmt: skip
        file.write_sets(data, "add" if number > 1 else "overwrite")
    return folder / "a.uff"


FORMATS = {"mat": _mat, "h5": _hdf5, "tdms": _tdms, "uff": _uff}


@functools.cache
def _good(kind: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return FORMATS[kind](Path(folder)).read_bytes()


def _refused(path: Path, says: str = "") -> None:
    with pytest.raises(RecordingError) as caught:
        read(path)
    text = str(caught.value)
    assert text.startswith(path.name) and says in text and len(text) < 1500 and text.isprintable(), text


@pytest.mark.parametrize("kind", FORMATS)
def test_the_whole_file_is_read(tmp_path: Path, kind: str) -> None:
    np.testing.assert_allclose(read(FORMATS[kind](tmp_path)).F, F, rtol=1e-6)  # universal files hold seven digits


@pytest.mark.parametrize("kind", FORMATS)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files_are_read_or_refused(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    raw = bytearray(_good(kind))
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(raw) - 1))
        length = data.draw(st.integers(0, 12))
        raw[place : place + length] = data.draw(st.binary(max_size=12))
    path = tmp_path / f"b.{kind}"
    path.write_bytes(raw)
    try:
        read_all([path], accept=["clipped", "wrong_unit", "swapped_sign", "constant"], resample=True)
    except RecordingError as error:
        for line in str(error).splitlines():
            assert line.startswith(path.name) and line.isprintable()


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_truncated_files(tmp_path: Path, kind: str, share: float) -> None:
    raw = _good(kind)
    path = tmp_path / f"b.{kind}"
    path.write_bytes(raw[: int(share * len(raw))])
    try:
        read(path)
    except RecordingError as error:
        assert str(error).startswith(path.name)


def test_sizes_that_no_machine_has(tmp_path: Path) -> None:
    """An HDF5 file of a few kB that says to hold 8 TB."""
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in ("t", "F", "x"):
            file.create_dataset(name, shape=(10**12,), dtype="f8", chunks=(1000,))
    _refused(tmp_path / "a.h5")


def test_memory_of_a_reader_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hystid.recording import apart

    monkeypatch.setenv("HYSTID_CHILD_MEMORY_MB", "300")
    apart._reader.close()
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("t", shape=(100_000_000,), dtype="f8", chunks=(1000,))
    try:
        _refused(tmp_path / "a.h5", "HYSTID_CHILD_MEMORY_MB")
    finally:
        apart._reader.close()


def test_other_files_are_not_read_by_way_of_links(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    secret = tmp_path / "secret.h5"
    with h5py.File(secret, "w") as file:
        for name, values in (("t", T), ("F", F), ("x", X)):
            file[name] = values
    with h5py.File(tmp_path / "linked.h5", "w") as file:
        for name in ("t", "F", "x"):
            file[name] = h5py.ExternalLink(str(secret), f"/{name}")
    _refused(tmp_path / "linked.h5", "no group holds")
    (tmp_path / "raw").write_bytes(T.tobytes())
    with h5py.File(tmp_path / "external.h5", "w") as file:
        for name in ("t", "F", "x"):
            file.create_dataset(name, shape=(N,), dtype="f8", external=[(str(tmp_path / "raw"), 0, 8 * N)])
    _refused(tmp_path / "external.h5", "from other files")
    layout = h5py.VirtualLayout((N,), "f8")
    layout[:] = h5py.VirtualSource(str(secret), "t", (N,))
    with h5py.File(tmp_path / "virtual.h5", "w") as file:
        for name in ("t", "F", "x"):
            file.create_virtual_dataset(name, layout)
    _refused(tmp_path / "virtual.h5", "from other files")


def test_circles_of_groups_and_references_end(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("one")
        group["again"] = file["/"]
        group["soft"] = h5py.SoftLink("/one/soft")
    _refused(tmp_path / "a.h5")
    with h5py.File(tmp_path / "b.h5", "w") as file:
        made = file.create_dataset("cells", (2,), dtype=h5py.ref_dtype)
        made[0] = made[1] = made.ref
    _refused(tmp_path / "b.h5")


def test_a_crash_costs_one_file(tmp_path: Path) -> None:
    """The reader's process is killed while nobody looks: the next file is read by another."""
    from hystid.recording import apart

    path = _mat(tmp_path)
    read(path)
    apart._reader._running._process.kill()
    np.testing.assert_array_equal(read(path).F, F)


def test_objects_of_matlab_and_numpy_run_no_code(tmp_path: Path) -> None:
    """Arrays of Python objects in files are pickles; no reader unpacks them."""
    buffer = io.BytesIO()
    np.save(buffer, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    for suffix in ("mat", "h5", "tdms", "uff"):
        (tmp_path / f"a.{suffix}").write_bytes(buffer.getvalue())
        _refused(tmp_path / f"a.{suffix}")


def test_a_broken_mdf_file_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """asammdf keeps a temporary file of its own where it fails."""
    asammdf = pytest.importorskip("asammdf", reason="needs the extra mdf")
    from hystid.recording import apart

    t = np.arange(100) * 1e-3
    with asammdf.MDF() as file:
        file.append([asammdf.Signal(samples=np.sin(t), timestamps=t, name="F", unit="N")])
        raw = Path(file.save(tmp_path / "a.mf4")).read_bytes()
    (tmp_path / "b.mf4").write_bytes(raw[: len(raw) // 2])
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setenv("TMPDIR", str(place))
    apart._reader.close()  # the next one takes the folder that is named now
    _refused(tmp_path / "b.mf4")
    apart._reader.close()
    assert list(place.iterdir()) == []
