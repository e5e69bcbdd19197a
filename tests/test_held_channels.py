"""A channel that stands still while another one moves, and sound channels that stand still as well."""

from pathlib import Path

import numpy as np
import pytest

from hystid.errors import RecordingError
from hystid.recording import Recording, read

DT, N = 1e-3, 4000
RNG = np.random.default_rng(8)
T = np.arange(N) * DT
LINES = [(3.0, 0.2, 1e-3), (7.3, 1.1, 6e-4), (12.1, 2.0, 3e-4)]  # Hz, rad, m


def motion(order: int) -> np.ndarray:
    return sum(
        (
            size * (2 * np.pi * f) ** order * np.sin(2 * np.pi * f * T + phase + order * np.pi / 2)
            for f, phase, size in LINES
        ),
        np.zeros(N),
    )


X, V, A = (motion(order) for order in range(3))
F = 2.0 * A + 12.0 * V + 2e4 * X


def noisy(values: np.ndarray) -> np.ndarray:
    return values + 0.01 * np.std(values) * RNG.standard_normal(N)


def digits(values: np.ndarray, bits: int) -> np.ndarray:
    step = 2.6 * np.max(np.abs(values)) / 2**bits
    return step * np.round(values / step)


def read_back(path: Path, **channels: np.ndarray) -> Recording:
    units = {"F": "N", "x": "m", "v": "m/s", "a": "m/s2"}
    head = ",".join(["t [s]", *(f"{name} [{units[name]}]" for name in channels)])
    np.savetxt(path, np.column_stack([T, *channels.values()]), delimiter=",", header=head, comments="")
    return read(path)


def held(values: np.ndarray, first: int = 2000, count: int = 80) -> np.ndarray:
    """The value repeated, as a link does that is interrupted."""
    return np.where((np.arange(N) >= first) & (np.arange(N) < first + count), values[first], values)


@pytest.mark.parametrize("bits", [10, 16])
@pytest.mark.parametrize(("name", "others"), [("x", "v"), ("v", "a"), ("v", "x"), ("a", "v"), ("x", "va")])
def test_is_refused_with_channel_and_sample(tmp_path: Path, name: str, others: str, bits: int) -> None:
    clean = {"x": X, "v": V, "a": A}
    channels = {other: noisy(clean[other]) for other in others} | {name: held(digits(noisy(clean[name]), bits))}
    with pytest.raises(RecordingError, match=rf"channel {name}: it stands at .* for \d+ samples while others move"):
        read_back(tmp_path / "link.csv", F=noisy(F), **channels)


def test_a_converter_that_is_slower_than_the_table_is_sound(tmp_path: Path) -> None:
    read_back(tmp_path / "slow.csv", F=noisy(F), x=X[np.arange(N) // 20 * 20], v=noisy(V))


def test_contacts_that_stick_are_sound(tmp_path: Path) -> None:
    """The place is the same to the last digit, and the velocity is noise."""
    rests = (np.arange(N) > 1500) & (np.arange(N) < 2500)
    x, v = np.where(rests, X[1500], X), np.where(rests, 0.0, V)
    x[2500:] += X[1500] - X[2500]
    v = v + 0.01 * np.std(V) * RNG.standard_normal(N) + 0.05 * np.std(V)  # and a zero that is off
    read_back(tmp_path / "sticks.csv", F=noisy(F), x=digits(x, 12), v=v)


def test_can_be_accepted(tmp_path: Path) -> None:
    path = tmp_path / "link.csv"
    with pytest.raises(RecordingError):
        read_back(path, F=noisy(F), x=held(X), v=noisy(V))
    assert any("while others move" in text for text in read(path, accept={"held"}).warnings)


@pytest.mark.parametrize("level", [0.6, 0.97])
def test_a_channel_that_is_cut_off_is_not_held(tmp_path: Path, level: float) -> None:
    """It stands at the end of its range: rule ``clipped`` speaks of it, and says what to do about that."""
    top = level * float(np.max(np.abs(X)))
    with pytest.raises(RecordingError, match="channel x: cut off at") as refused:
        read_back(tmp_path / "range.csv", F=F, x=np.clip(X, -top, top), v=V, a=A)
    assert "[held]" not in str(refused.value)
