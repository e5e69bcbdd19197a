"""Reading CSV, writing it back, and the checks at the door."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hystid.consistency import admit
from hystid.errors import RecordingError, UsageError
from hystid.recording import Recording, read, read_all, write_csv
from hystid.smoothing.noise import noise_level

DATA = Path(__file__).parents[1].parent / "shared" / "data"
FORCELESS = ("linear_actuator_faults", "magneto_elastic_decay")
REAL = sorted(path for path in DATA.glob("*/*.csv") if path.parent.name not in FORCELESS)

DT, N = 1e-3, 2000
T = np.arange(N) * DT
X = 1e-3 * np.sin(2 * np.pi * 9 * T)
V = 1e-3 * 18 * np.pi * np.cos(2 * np.pi * 9 * T)
A = -1e-3 * (18 * np.pi) ** 2 * np.sin(2 * np.pi * 9 * T)
F = 2 * A + 40 * V + 5e4 * X
GOOD = {"t [s]": T, "F [N]": F, "x [m]": X, "v [m/s]": V, "a [m/s2]": A}


def write(path: Path, columns: dict[str, np.ndarray], separator: str = ",") -> Path:
    rows = zip(*columns.values(), strict=False)
    lines = [separator.join(columns), *(separator.join(f"{value:.9g}" for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def refused(path: Path, **arguments: object) -> str:
    with pytest.raises(RecordingError) as caught:
        admit([read(path, **arguments)])  # type: ignore[arg-type]
    return str(caught.value)


# --- reading ----------------------------------------------------------------------------------------------------


def test_units_become_si(tmp_path: Path) -> None:
    columns = {
        "Time [ms]": 1e3 * T,
        "Force [kN]": F / 1e3,
        "disp [mm]": 1e3 * X,
        "vel (mm/s)": 1e3 * V,
        "acc [g]": A / 9.80665,
    }
    found = read(write(tmp_path / "units.csv", columns))
    for name, expected in {"F": F, "x": X, "v": V, "a": A}.items():
        np.testing.assert_allclose(found.channel(name), expected, rtol=1e-7, atol=1e-9 * np.max(np.abs(expected)))
    assert found.dt == pytest.approx(DT, rel=1e-9)
    assert "F converted from kN to N" in found.notes
    assert not found.warnings


@pytest.mark.parametrize(
    ("name", "head", "change"),
    [
        ("semicolon", "", lambda text: text.replace(",", ";")),
        ("tab", "", lambda text: text.replace(",", "\t")),
        ("decimal comma", "", lambda text: text.replace(",", ";").replace(".", ",")),
        ("byte order mark", "\ufeff", lambda text: text),
        ("comments and blanks", "# rig 4\n\n% second run\n", lambda text: text.replace("\n", "\n\n", 3)),
        ("windows line ends", "", lambda text: text.replace("\n", "\r\n")),
        ("separator at line ends", "", lambda text: text.replace("\n", ",\n")),
        ("quoted headers", "", lambda text: text.replace("F [N]", '"F [N]"')),
    ],
)
def test_relatives_of_csv_read_alike(tmp_path: Path, name: str, head: str, change: Callable[[str], str]) -> None:
    plain = read(write(tmp_path / "plain.csv", GOOD))
    other = tmp_path / "other.csv"
    other.write_bytes((head + change((tmp_path / "plain.csv").read_text())).encode("utf-8"))
    found = read(other)
    for channel in "FxvaR"[:4]:
        np.testing.assert_array_equal(found.channel(channel), plain.channel(channel))


def test_a_second_line_of_units_is_understood(tmp_path: Path) -> None:
    path = write(tmp_path / "units.csv", {"t": T, "F": F, "x": 1e3 * X}, ";")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], "s;N;mm", *lines[1:]]))
    np.testing.assert_allclose(read(path).channel("x"), X, atol=1e-12)


def test_voltages_need_a_sensitivity(tmp_path: Path) -> None:
    path = write(tmp_path / "volt.csv", {"t [s]": T, "F [V]": F * 0.0224, "x [m]": X, "a [mV]": A / 9.80665 * 100})
    both = {"F": "22.4 mV/N", "a": "100mV/g"}
    np.testing.assert_allclose(read(path, sensitivity=both).channel("F"), F, atol=1e-6)
    np.testing.assert_allclose(read(path, sensitivity=both).channel("a"), A, atol=1e-6)
    per_volt = {"F": f"{1 / 0.0224}N/V", "a": "0.0980665 m/s2/mV"}
    np.testing.assert_allclose(read(path, sensitivity=per_volt).channel("F"), F, atol=1e-6)
    assert refused(path).count("--sensitivity") == 2
    with pytest.raises(UsageError, match="for example 22"):
        read(path, sensitivity={"F": "22.4 mV/m", "a": "1"})


def test_a_sensitivity_without_a_voltage_is_told(tmp_path: Path) -> None:
    path = write(tmp_path / "newton.csv", {"t [s]": T, "F [N]": F, "x [m]": X})
    found = read(path, sensitivity={"F": "22.4 mV/N", "a": "100 mV/g"})
    np.testing.assert_allclose(found.channel("F"), F, atol=1e-6)
    assert "it is in N and no voltage" in "".join(found.warnings)
    assert "--sensitivity a is given, and there is no such channel" in "".join(found.warnings)


def test_a_column_without_unit_is_a_voltage_where_its_sensor_is_given(tmp_path: Path) -> None:
    path = write(tmp_path / "bare.csv", {"t [s]": T, "F": F * 0.0224, "x [m]": X})
    found = read(path, sensitivity={"F": "22.4 mV/N"})
    np.testing.assert_allclose(found.channel("F"), F, atol=1e-6)
    assert "taken as V" in "".join(found.warnings)


def test_a_torque_in_volts_turns(tmp_path: Path) -> None:
    path = write(tmp_path / "volt.csv", {"t [s]": T, "Torque [V]": F * 0.0224, "Angle [deg]": np.rad2deg(X)})
    found = read(path, sensitivity={"F": "22.4 mV/N.m"})
    assert found.rotational
    np.testing.assert_allclose(found.channel("F"), F, atol=1e-6)
    both = write(tmp_path / "volts.csv", {"t [s]": T, "Torque [V]": F, "Angle [V]": X})
    assert read(both, sensitivity={"F": "1 V/N.m", "x": "1 V/rad"}).rotational


def test_wishes_that_a_file_has_nothing_for_are_told(tmp_path: Path) -> None:
    path = write(tmp_path / "two.csv", {"t [s]": T, "F [N]": F, "x [m]": X, "Load2 [N]": 2 * F})
    found = read(path, names={"F": "Laod2"}, units={"v": "mm/s"}, reverse=["a"])
    told = "".join(found.warnings)
    assert "there is no column 'Laod2' (--channel F=Laod2); column 'F' is taken" in told
    assert "--unit v is given, and there is no such channel" in told
    assert "--reverse a is given, and there is no such channel" in told
    assert not read(path, names={"F": "Load2"}, units={"x": "m"}, reverse=["F"]).warnings


def test_own_column_names_are_chosen_and_near_misses_answered(tmp_path: Path) -> None:
    path = write(tmp_path / "own.csv", {"t [s]": T, "Sensor 1 [N]": F, "LVDT [mm]": 1e3 * X})
    assert "there is no channel F" in refused(path)
    found = read(path, names={"F": "Sensor 1", "x": "LVDT"})
    np.testing.assert_allclose(found.channel("x"), X, atol=1e-12)
    with pytest.raises(UsageError, match="did you mean Sensor 1"):
        read(path, names={"F": "Sensor1"})


def test_extra_columns_stay_and_two_files_of_one_name_differ(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    paths = [write(folder / "run.csv", GOOD | {"p [bar]": T}) for folder in (tmp_path, tmp_path / "b")]
    first, second = read_all(paths)
    assert (first.name, second.name) == ("run", "run-2")
    np.testing.assert_allclose(first.extra["p"], 1e5 * T, atol=1e-6)


def test_pseudo_time_is_no_measured_time(tmp_path: Path) -> None:
    found = read(write(tmp_path / "static.csv", {"t_pseudo [s]": T, "F [N]": F, "x [m]": X}))
    assert found.quasi_static
    assert any("not a measured time" in note for note in found.notes)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32 - 1), st.sampled_from(["x", "xv", "xva", "a"]), st.floats(1e-6, 1e-1))
def test_what_is_written_is_read_back_bit_for_bit(tmp_path: Path, seed: int, channels: str, dt: float) -> None:
    noise = np.random.default_rng(seed).normal(size=(5, 64))
    given_channels = {name: noise[k] * 1e-3 for k, name in enumerate(channels)}
    made = Recording("made", np.arange(64) * dt, F=noise[4], **given_channels, notes=("a note\nof two lines",))
    write_csv(made, tmp_path / "made.csv")
    every = ("swapped_sign", "wrong_unit", "not_one_motion")  # noise is no motion
    found = read(tmp_path / "made.csv", accept=every)
    for name in ("F", *channels):
        np.testing.assert_array_equal(found.channel(name), made.channel(name))
    np.testing.assert_allclose(found.t, made.t, rtol=1e-12)


def test_a_failed_writing_leaves_nothing(tmp_path: Path) -> None:
    broken = Recording("broken", T, F=F, x=X[:-1])
    with pytest.raises(ValueError, match="dimension"):
        write_csv(broken, tmp_path / "broken.csv")
    assert list(tmp_path.iterdir()) == []


# --- what is refused at the door ----------------------------------------------------------------------------------


def spoilt(**changes: np.ndarray) -> dict[str, np.ndarray]:
    named = {key.split(" ")[0]: key for key in GOOD}
    return {**GOOD, **{named[name]: values for name, values in changes.items()}}


def at(values: np.ndarray, sample: int | slice, value: float) -> np.ndarray:
    changed = values.copy()
    changed[sample] = value
    return changed


BAD = {
    "NaN": (spoilt(x=at(X, slice(40, 70), np.nan)), "line 42, sample 40, channel x: 30 of 2000 samples are NaN"),
    "infinite": (spoilt(F=at(F, 7, np.inf)), "line 9, sample 7, channel F"),
    "reversed time": (spoilt(t=T[::-1]), "time runs backwards throughout"),
    "one step back": (spoilt(t=at(T, 100, T[98])), "time repeats|time runs backwards"),
    "duplicated time": (spoilt(t=at(T, 100, T[99])), "line 102, sample 100, channel t: time repeats"),
    "unequal steps": (spoilt(t=np.cumsum(np.random.default_rng(1).uniform(0.2, 2, N)) * DT), "unequal_steps"),
    "constant force": (spoilt(F=np.full(N, 3.0)), "channel F: the channel is constant"),
    "dead velocity sensor": (spoilt(v=np.zeros(N)), "channel v: the channel is constant"),
    "clipped force": (spoilt(F=np.clip(F, -0.6 * F.max(), 0.6 * F.max())), "channel F: cut off at"),
    "clipped on one side": (spoilt(a=np.minimum(A, 0.8 * A.max())), "channel a: cut off at"),
    "x in mm labelled m": (spoilt(x=1e3 * X), "it looks like mm;"),
    "v in mm/s labelled m/s": (spoilt(v=1e3 * V), "it looks like mm/s;"),
    "a in g labelled m/s2": (spoilt(a=A / 9.80665), "it looks like g;"),
    "v with the wrong sign": (spoilt(v=-V), "v has the wrong sign"),
    "a with the wrong sign": (spoilt(a=-A), "a has the wrong sign"),
    "F with the wrong sign": (spoilt(F=-F), "F has the wrong sign"),
    "quasi-static F with the wrong sign": (
        {"t_pseudo [s]": T, "F [N]": -F, "x [m]": X},
        "F or x has the wrong sign",
    ),
    "F without motion": ({"t [s]": T, "F [N]": F}, "there is no motion x, v or a"),
    "no force": ({"t [s]": T, "x [m]": X}, "there is no channel F"),
    "no time": ({"F [N]": F, "x [m]": X}, "there is no channel t"),
    "3 samples": ({key: values[:3] for key, values in GOOD.items()}, "3 samples; at least 16 are needed"),
    "unit of something else": ({"t [s]": T, "F [mm]": F, "x [m]": X}, "unit 'mm' cannot be converted to N"),
    "unknown unit": ({"t [s]": T, "F [wurst]": F, "x [m]": X}, "unit 'wurst' is not known"),
    "two force columns": ({"t [s]": T, "F [N]": F, "Force [N]": F, "x [m]": X}, "columns 'F' and 'Force' both mean F"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_recordings_are_named(tmp_path: Path, name: str) -> None:
    import re

    columns, expected = BAD[name]
    message = refused(write(tmp_path / "bad.csv", columns))
    assert re.search(expected, message), message
    assert message.startswith("bad")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "the file is empty"),
        ("t [s],F [N],x [m]\n", "a header but no sample"),
        ("1,2,3\n4,5,6\n", "the first line holds numbers instead of names"),
        ("t [s],F [N],x [m]\n0,1,2\n1,2\n", "line 3, sample 1: 2 cells where the header names 3 columns"),
        ("t [s],F [N],x [m]\n0,1,2\n1,abc,3\n", "line 3, sample 1, channel F: 'abc' is not a number"),
        ("t [s],F [N],x [m]\n0,1,2\n1,,3\n", "line 3, sample 1, channel F: the cell is empty"),
        ("t [s],F [N],x [m]\n0,1,5,2,7,8\n", "commas separate both columns and decimals"),
        ("t [s];F [N];x [m]\n0;1.200,5;2\n", "decimal point and decimal comma are mixed"),
        ("t [s]\n0\n1\n", "only one column is there"),
        ("PK\x03\x04\x00\x00", "this is a binary file"),
    ],
)
def test_text_that_is_no_table(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_bytes(text.encode("latin-1"))
    assert expected in refused(path)


def test_every_problem_of_every_file_is_reported_at_once(tmp_path: Path) -> None:
    one = write(tmp_path / "one.csv", spoilt(F=at(F, 3, np.inf), v=np.zeros(N), t=at(T, 50, T[49])))
    two = write(tmp_path / "two.csv", spoilt(x=np.zeros(N), a=np.ones(N)))
    with pytest.raises(RecordingError) as caught:
        read_all([one, two, tmp_path / "three.csv"])
    lines = str(caught.value).splitlines()
    assert [line.split(".csv")[0].rpartition("/")[2] for line in lines] == ["one"] * 3 + ["two"] * 2 + ["three"]


def test_a_rule_can_be_accepted_and_then_warns(tmp_path: Path) -> None:
    path = write(tmp_path / "active.csv", spoilt(F=-F))
    (found,) = admit([read(path, accept=("swapped_sign",))])
    assert "F has the wrong sign" in found.warnings[0]
    with pytest.raises(UsageError, match="the rules are"):
        read(path, accept=("swaped_sign",))


@pytest.mark.parametrize("name", ["missing.csv", "folder.csv", "table.xlsx"])
def test_what_is_no_recording_file(tmp_path: Path, name: str) -> None:
    if name.startswith("folder"):
        (tmp_path / name).mkdir()
    elif name.endswith("xlsx"):
        (tmp_path / name).write_text("x")
    assert name in refused(tmp_path / name)


# --- what must not be refused -------------------------------------------------------------------------------------


def test_gaps_keep_the_longest_part_and_say_so(tmp_path: Path) -> None:
    late = T + np.where(np.arange(N) >= 300, 0.5, 0.0)
    found = read(write(tmp_path / "gap.csv", spoilt(t=late)))
    assert len(found) == 1700
    assert "1 gap in time, the first of 0.501 s before t = 0.8 s" in found.warnings[0]
    whole = read(write(tmp_path / "gap.csv", spoilt(t=late)), resample=True)
    assert len(whole) == 2500
    many = T + 0.5 * (np.arange(N) // 400)
    assert "4 gaps in time" in refused(write(tmp_path / "gaps.csv", spoilt(t=many)))


def test_dropped_samples_and_rounded_stamps_are_put_on_the_grid(tmp_path: Path) -> None:
    keep = np.ones(N, dtype=bool)
    keep[[200, 700, 701]] = False
    found = read(write(tmp_path / "lost.csv", {key: values[keep] for key, values in GOOD.items()}))
    assert len(found) == N
    assert "3 samples missing at 2 places" in found.warnings[0]
    # linear interpolation over 3 ms of a 9 Hz sine: (w T)^2 / 8
    np.testing.assert_allclose(found.channel("x"), X, atol=1e-3 * (18 * np.pi * 3e-3) ** 2 / 8)
    rounded = read(write(tmp_path / "rounded.csv", spoilt(t=np.round(np.arange(N) / 750, 6))))
    assert rounded.sample_rate == pytest.approx(750, rel=1e-5)
    assert not rounded.warnings


def test_quantised_signals_and_dwells_are_not_clipped(tmp_path: Path) -> None:
    digit = 2e-5
    coarse = np.round(X / digit) * digit
    slow = np.concatenate([coarse[:500], np.full(300, coarse[499]), coarse[500:1700]])
    assert not read(write(tmp_path / "coarse.csv", {"t [s]": T, "F [N]": F, "x [m]": coarse})).warnings
    read(write(tmp_path / "dwell.csv", {"t [s]": T, "F [N]": F + 5e4 * (slow - X), "x [m]": slow}))


def test_a_free_decay_is_not_taken_for_a_swapped_sign(tmp_path: Path) -> None:
    decay = np.exp(-2 * T) * np.cos(2 * np.pi * 9 * T)
    force = 2.0 * np.random.default_rng(2).normal(size=N)  # hardly any force: no sign can be told from it
    read(write(tmp_path / "decay.csv", {"t [s]": T, "F [N]": force, "x [m]": 1e-3 * decay}))
    read(write(tmp_path / "spring.csv", {"t [s]": T, "F [N]": 5e4 * 1e-3 * decay, "x [m]": 1e-3 * decay}))


@pytest.mark.skipif(not REAL, reason="the real recordings (../shared/data) are not on this machine")
@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_every_real_recording_loads(path: Path) -> None:
    found = read(path)
    assert len(found) >= 380
    gaps = path.stem.startswith("pneumatic")
    assert bool(found.warnings) == gaps, found.warnings
    assert all("gap" in warning for warning in found.warnings)
    assert found.rotational == path.parent.name.startswith(("servo", "torque", "cycloidal"))


@pytest.mark.skipif(not REAL, reason="the real recordings (../shared/data) are not on this machine")
def test_an_actuator_without_a_force_sensor_is_refused_with_the_reason() -> None:
    path = next((DATA / "linear_actuator_faults").glob("*.csv"))
    assert "a current, a command or a set point is no measured force" in refused(path)


@pytest.mark.parametrize("idle", [0.95, 0.6])
def test_blows_between_a_few_samples_are_neither_cut_off_nor_a_staircase(tmp_path: Path, idle: float) -> None:
    """A hammer in a simulation: the force is exactly 0 between blows of three samples."""
    force = np.zeros(N)
    every = round(3 / (1 - idle))
    for at in range(20, N - 4, every):
        force[at : at + 3] = [60.0, 100.0, 30.0]
    found = read(write(tmp_path / "hammer.csv", {"t [s]": T, "F [N]": force, "x [m]": X}))
    assert not [w for w in found.warnings if "cut off" in w]
    assert noise_level(force) < 1e-3
    stairs = np.where(np.arange(N) < N // 2, 0.0, np.round(np.sin(0.01 * np.arange(N)) * 20))
    assert noise_level(stairs) > 0.1  # a display that counts, half of the time at rest
