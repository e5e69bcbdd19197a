"""Do the channels fit together: one relation after the other, on motions whose truth is known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.signal import butter, lsim, savgol_filter, sosfilt, sosfiltfilt

from hystid.compiled import CompiledModel
from hystid.consistency import admit, examine
from hystid.consistency.examine import _judged_force
from hystid.consistency.force import examine_force
from hystid.consistency.slips import Explanation, Slip, with_alike
from hystid.errors import RecordingError
from hystid.modelica import compile_model
from hystid.numeric import Array
from hystid.recording import Recording
from hystid.units import to_si

RATE, N, MASS, DAMPING, STIFFNESS = 1000.0, 6000, 2.5, 30.0, 4e4
UNITS = {"N.mm": 1e3, "N.cm": 100.0, "mN.m": 1e3}


def rig(noise_db: float | None = 40.0, seed: int = 0) -> Recording:
    """A linear oscillator under a force of many lines: its answer is exact, line by line."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) / RATE
    omega = 2 * np.pi * np.arange(12, 480) * RATE / N  # 2 to 80 Hz
    phase = rng.uniform(0, 2 * np.pi, len(omega))
    line = np.exp(1j * (np.outer(t, omega) + phase))
    answer = 1.0 / (STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING)
    force = np.real(line @ np.ones(len(omega)))
    x, v, a = (np.real(line @ (answer * (1j * omega) ** k)) for k in (0, 1, 2))
    channels = {"F": force, "x": x, "v": v, "a": a}
    if noise_db is not None:
        channels = {k: u + np.std(u) * 10 ** (-noise_db / 20) * rng.standard_normal(N) for k, u in channels.items()}
    return Recording("rig", t, **channels, origin=dict.fromkeys(channels, "measured"))


@pytest.mark.parametrize("noise_db", [20.0, 40.0, 60.0, 80.0, None])
def test_a_sound_recording_has_no_findings(noise_db: float | None) -> None:
    found = examine([rig(noise_db)], mass=MASS)
    assert found.findings == []
    balance = found.examined[0].balance
    assert balance is not None and balance.mass == pytest.approx(MASS, rel=0.1)  # at 20 dB: noise of a tells less mass


@pytest.mark.parametrize("noise_db", [40.0, 60.0, 80.0])
def test_good_sensors_stay_measurements(noise_db: float) -> None:
    """However closely x, v and a agree: their errors are their own."""
    assert examine([rig(noise_db)]).measured("rig") == ["F", "x", "v", "a"]


@pytest.mark.parametrize("noise_db", [30.0, 50.0, 70.0])
def test_difference_quotients_are_no_measurements(noise_db: float) -> None:
    plain = rig(noise_db)
    assert plain.x is not None
    v = np.gradient(plain.x, 1 / RATE)
    made = replace(plain, v=v, a=np.gradient(v, 1 / RATE))
    assert examine([made]).measured("rig") == ["F", "x"]


@pytest.mark.parametrize(
    ("channel", "factor", "said"),
    [("a", 1 / 9.80665, "looks like g"), ("a", 1 / 0.3048, "ft/s2"), ("x", 1e3, "mm"), ("v", 1e3, "mm/s")],
)
def test_a_wrong_unit_is_named(channel: str, factor: float, said: str) -> None:
    plain = rig()
    values = getattr(plain, channel)
    with pytest.raises(RecordingError, match=rf"channel {channel}: .*{said}"):
        admit([replace(plain, **{channel: factor * values})])


@pytest.mark.parametrize("channel", ["F", "x", "v", "a"])
def test_a_reversed_channel_is_named(channel: str) -> None:
    plain = rig()
    with pytest.raises(RecordingError, match=rf"channel {channel}: .*--reverse {channel}"):
        admit([replace(plain, **{channel: -getattr(plain, channel)})])


def test_time_in_milliseconds_is_named() -> None:
    plain = rig()
    with pytest.raises(RecordingError, match="t looks like ms"):
        admit([replace(plain, t=1e3 * plain.t)])


def test_exchanged_columns_are_named() -> None:
    plain = rig()
    with pytest.raises(RecordingError, match="exchanged"):
        admit([replace(plain, x=plain.a, a=plain.x)])


LABELS = {"F": ("kN", 1e3), "x": ("mm", 1e-3), "v": ("mm/s", 1e-3), "a": ("g", 9.80665)}


@pytest.mark.parametrize(
    ("one", "other", "channels"),
    [("x", "a", "xva"), ("x", "a", "xa"), ("x", "v", "xva"), ("F", "x", "xa"), ("F", "a", "xa")],
)
def test_labels_that_are_exchanged_with_their_units_are_named(one: str, other: str, channels: str) -> None:
    """As a file shows them: the numbers of a in g stand under x [mm], and are read as mm."""
    plain = rig()
    plain = replace(plain, **{name: None for name in "xva" if name not in channels})
    wrong = {
        label: plain.channel(held) / LABELS[held][1] * LABELS[label][1] for label, held in ((one, other), (other, one))
    }
    read = replace(plain, **wrong, units={name: LABELS[name][0] for name in ("F", *channels)})
    found = examine([read], MASS).findings
    assert [(f.slip, set(f.channel.split(" and "))) for f in found] == [("swapped_channels", {one, other})]
    differ = LABELS[one][1] != LABELS[other][1]  # else the columns may be chosen by name
    assert ("names and units of these columns are exchanged" in found[0].mend) == differ
    assert examine([replace(plain, units=read.units)], MASS).findings == []


def test_exchanged_columns_are_named_where_noise_hides_the_motion_of_one() -> None:
    """A slow test: the second derivative of the column called x is the noise of an accelerometer of 25 dB."""
    t = np.arange(6000) / 100
    lines = np.random.default_rng(4).uniform(0, 2 * np.pi, 40)
    w = 2 * np.pi * np.linspace(0.05, 0.6, 40)
    x, v = (0.01 * np.sum(w**k * np.cos(np.outer(t, w) + lines + k * np.pi / 2), axis=1) for k in (0, 1))
    a = -0.01 * np.sum(w**2 * np.cos(np.outer(t, w) + lines), axis=1)
    noise = np.random.default_rng(5).standard_normal((3, len(t)))
    x, a = x + 1e-3 * np.std(x) * noise[0], a + 10 ** (-25 / 20) * np.std(a) * noise[1]
    F = 20 * np.tanh(v / 1e-3) + 100 * x + 0.1 * noise[2]
    assert examine([Recording("slow", t, F, x=x, a=a)], mass=4.0).findings == []
    (finding,) = examine([Recording("slow", t, F, x=a, a=x)], mass=4.0).findings
    assert (finding.slip, finding.channel) == ("swapped_channels", "x and a")


def test_a_mass_in_grams_is_named() -> None:
    with pytest.raises(RecordingError, match=r"says a mass of 2\.5"):
        admit([rig()], mass=1e3 * MASS)


def test_a_mass_in_grams_and_a_force_in_kilonewton_are_both_told_where_sizes_do_not_tell() -> None:
    # 250 kg under a few newtons are as unusual as a few newtons that were kilonewtons
    light = replace(rig(), F=0.1 * np.asarray(rig().F))
    found = examine([light], mass=1e3 * 0.1 * MASS).findings
    assert {(item.channel, item.slip) for item in found} == {("F", "wrong_unit"), ("m", "wrong_mass")}
    text = " ".join(map(str, found))
    assert "looks like kN" in text and "or else" in text and "says a mass of 0.25" in text
    assert not any(item.repair for item in found)  # nobody knows which one mends it


def test_a_force_without_the_inertia_of_the_mass_is_no_recording_of_it() -> None:
    """x as a copy of F over a stiffness: laws explain all of F, and 2.5 kg would be three quarters of it."""
    plain = rig()
    assert plain.F is not None
    noise = np.random.default_rng(1).normal(0, 1e-2 * np.std(plain.F), N)
    copy = replace(plain, x=(plain.F + noise) / STIFFNESS, v=None, a=None)
    with pytest.raises(RecordingError, match=r"F shows no mass: 2\.5 kg would change it by .* \[wrong_mass\]"):
        admit([copy], mass=MASS)
    assert examine([copy], mass=0.0).findings == []


def test_a_late_force_is_measured_in_milliseconds() -> None:
    plain = rig()
    assert plain.F is not None
    late = replace(plain, F=np.roll(plain.F, 12))
    (finding,) = examine([late]).findings
    assert finding.slip == "lag" and finding.seen["lag"] == pytest.approx(0.012, abs=5e-4)  # half a sample


def test_accepted_slips_are_warnings() -> None:
    plain = rig()
    assert plain.F is not None
    (taken,) = admit([replace(plain, F=-plain.F)], accept=["swapped_sign"])
    assert any("wrong sign" in text for text in taken.warnings)


@pytest.mark.parametrize("name", ["v", "a"])
def test_a_clock_in_milliseconds_beside_one_channel_of_motion(name: str) -> None:
    """The mass tells with v. F over a is the same in any time: there the displacement that a means tells."""
    plain = rig()
    alone = replace(plain, **{other: None for other in "xva" if other != name})
    assert not examine([alone], mass=MASS).refusals
    (found,) = examine([replace(alone, t=1e3 * alone.t)], mass=MASS).refusals
    assert found.slip == "wrong_unit" and found.channel == {"v": "t", "a": "a"}[name]


@pytest.mark.parametrize("unit", ["kN", "lbf"])
def test_the_mass_tells_the_unit_of_the_force(unit: str) -> None:
    plain = rig()
    assert plain.F is not None
    with pytest.raises(RecordingError, match=f"channel F: .*looks like {unit}"):
        admit([replace(plain, F=plain.F / to_si(unit, "N")[0])], mass=MASS)


def test_what_no_channel_can_confirm_is_said() -> None:
    """Without a mass nothing weighs the force; with it, each unit but the right one is found."""
    assert "lbf" in examine([rig()]).undecided("F")[0]
    assert examine([rig()], mass=MASS).undecided("F") == []


def test_a_unit_of_the_mass_is_undecided_where_fixtures_may_weigh_as_much() -> None:
    """F over a shows the mass to a per cent. Of 2.5 kg, which it shows, 2.5 lb would leave less than half; of 3.7 kg it
    shows 2.5, and 3.7 lb are as near to that."""
    assert examine([rig()], mass=MASS).undecided("m") == []
    (told,) = examine([rig()], mass=1.48 * MASS).undecided("m")
    assert "in lb does not show: fixtures and springs may weigh as much as the unit would change" in told
    (told,) = examine([replace(rig(), x=None, v=None, a=rig(-10.0).a)], mass=MASS).undecided("m")
    assert "F over a shows the mass too roughly" in told
    assert "the mass is not known" in examine([rig()]).summary()


@pytest.mark.parametrize(("channel", "kind", "side"), [("a", "high", "lost below"), ("x", "low", "lost above")])
def test_a_filter_is_told_from_a_lag(channel: str, kind: str, side: str) -> None:
    """Both turn the phase; the course over frequency tells them apart. The corner is that of the filter within 5 %."""
    plain = rig()
    corner = 12.0
    values = sosfilt(butter(2 if kind == "low" else 1, corner, kind, fs=RATE, output="sos"), getattr(plain, channel))
    (finding,) = examine([replace(plain, **{channel: values})]).findings
    assert (finding.slip, finding.channel) == ("filtered", channel)
    assert finding.seen[side] == pytest.approx(corner, rel=0.05)


@pytest.mark.parametrize("corner", [0.5, 1.0])
def test_ac_coupling_below_the_motion_is_said_where_it_feigns_damping(corner: float) -> None:
    """The test begins at 2 Hz, so the size shows nothing; but a leads, which adds m times the corner to the damping."""
    plain = rig()
    a = sosfilt(butter(1, corner, "high", fs=RATE, output="sos"), plain.channel("a"))
    found = examine([replace(plain, a=a)], mass=MASS).findings
    feigned = MASS * 2 * np.pi * corner
    assert feigned > 0.1 * DAMPING
    assert [(f.slip, f.channel) for f in found] == [("filtered", "a")]
    assert found[0].seen["lost below"] == pytest.approx(corner, rel=0.1)


def test_the_force_may_hold_another_channel_than_its_own() -> None:
    plain = rig()
    with pytest.raises(RecordingError, match="F and x are exchanged"):
        admit([replace(plain, x=plain.F, F=plain.x)])


def test_slow_wandering_of_a_velocity_is_drift() -> None:
    plain = rig()
    assert plain.v is not None
    wave = 0.3 * np.std(plain.v) * np.sin(2 * np.pi * 0.4 * plain.t)
    for channels in ({}, {"x": None}):  # an acceleration alone shows as well that the structure does not move so
        (finding,) = examine([replace(plain, v=plain.v + wave, **channels)]).findings
        assert (finding.slip, finding.channel) == ("drift", "v")
    assert examine([replace(plain, x=None)]).findings == []


def _sensed(force: np.ndarray, motion: dict[str, np.ndarray], rate: float, noise_db: float, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    channels = {
        name: u + np.std(u) * 10 ** (-noise_db / 20) * rng.standard_normal(len(u))
        for name, u in {"F": force, **motion}.items()
    }
    t = np.arange(len(force)) / rate
    return Recording("other", t, **channels, origin=dict.fromkeys(channels, "measured"))


@pytest.mark.parametrize("seed", [24, 47])
def test_a_sine_is_not_late_by_the_phase_of_its_noise(seed: int) -> None:
    """A band of noise that looks coherent by chance weighs most in a lag, for its frequency is the highest."""
    t = np.arange(4096) / 512
    w = 2 * np.pi * 1.5
    x, v, a = 0.02 * np.sin(w * t), 0.02 * w * np.cos(w * t), -0.02 * w**2 * np.sin(w * t)
    force = 900 * v / (1 + np.abs(v) / 0.1) + 250 * np.tanh(v / 0.01) + 800 * x
    assert examine([_sensed(force, {"x": x, "v": v, "a": a}, 512.0, 45.0, seed)], mass=0.0).findings == []


@pytest.mark.parametrize("channel", ["v", "a"])
def test_a_spring_is_no_negative_mass(channel: str) -> None:
    """Three slow cycles on a stiff spring, without x: inertia is a thousandth of the force, and does not show."""
    t = np.arange(1500) / 100
    w = 2 * np.pi * 0.2
    x = 0.01 * np.sin(w * t) * np.minimum(1, t / 10)
    v = np.gradient(x, t)
    a = np.gradient(v, t)
    force = 3e4 * x + 300 * np.tanh(v / 1e-4) + 20 * a
    found = examine([_sensed(force, {channel: {"v": v, "a": a}[channel]}, 100.0, 45.0, 0)], mass=20.0)
    assert found.findings == []


def test_a_rig_that_turns_round_hides_its_acceleration_in_the_noise_of_its_angle() -> None:
    """Thirty decibels of a ramp are more than all that moves beside it: unlike, but no other motion."""
    t = np.arange(8000) / 1000
    w = 2 * np.pi * 1.3
    v = 40 + 3 * np.sin(w * t) * np.minimum(1, t)
    x, a = np.cumsum(v) / 1000, np.gradient(v, t)
    force = 0.005 * a + 0.004 * v + 0.02
    turning = replace(_sensed(force, {"x": x, "v": v, "a": a}, 1000.0, 30.0, 0), rotational=True)
    assert examine([turning], mass=0.005).findings == []


def test_force_and_acceleration_alone_show_the_sign_of_the_force() -> None:
    """Displacement and velocity are integrated above the drift only: the force is explained as with all channels."""
    plain = rig(45.0)
    alone = replace(plain, x=None, v=None)
    balance = examine([alone], mass=MASS).examined[0].balance
    assert balance is not None and balance.passive > 0.99  # the noise of a leaves 10^(-45/20) of its size, times Q < 3
    assert plain.F is not None
    (found,) = examine([replace(alone, F=-plain.F)], mass=MASS).findings
    assert found.slip == "swapped_sign"


@pytest.mark.parametrize(("hertz", "samples"), [(18.7, 2437), (13.6, 3887), (10.9, 5276), (4.2, 2472)])
def test_a_tone_that_is_cut_within_its_period_keeps_its_sign(hertz: float, samples: int) -> None:
    """Below a resonance force and acceleration are in antiphase. The displacement says why: a slow line or curve that
    is fitted to a cut tone must not stay in it, as it is integrated twice."""
    t, omega, rng = np.arange(samples) / 1000.0, 2 * np.pi * hertz, np.random.default_rng(samples)
    a = np.imag(-(omega**2) * 4.0 / (2e4 - omega**2 + 5j * omega) * np.exp(1j * omega * t))
    noise = rng.standard_normal((2, samples))
    tone = Recording("tone", t, F=4 * np.sin(omega * t) + 1e-3 * noise[0], a=a + 3e-4 * np.std(a) * noise[1])
    found = examine([tone], 1.0)
    assert not found.findings and not found.refusals


def test_units_that_the_data_do_not_tell_apart_are_listed_once() -> None:
    """N.mm and mN.m are one size under two names; N.cm is ten times as large."""
    one, other, same = (Slip("unit", ("F",), -5.0, size, ("N.m", u)) for u, size in UNITS.items())
    ordered = [Explanation((slip,), score, 0.0) for slip, score in ((one, 3.0), (other, 2.0), (same, 1.0))]
    assert with_alike(ordered).alike == ("N.cm",)


@pytest.mark.parametrize("mass", [MASS, 1e-3 * MASS])
def test_a_mass_in_tonnes_and_a_clock_in_milliseconds_are_both_told_where_sizes_do_not_tell(mass: float) -> None:
    """Of v and F alone both look the same: F over dv/dt. A rig of usual size tells them apart, one in between not."""
    plain = rig()
    alone = replace(plain, x=None, a=None, t=1e3 * plain.t if mass == MASS else plain.t)
    (finding,) = examine([alone], mass=mass).findings
    assert finding.channel == ("t" if mass == MASS else "m")
    between = replace(plain, x=None, a=None, t=60 * plain.t)  # 17 Hz, or 17 kHz
    found = examine([between], mass=1e-3 * MASS * 60).findings
    assert {item.channel for item in found} == {"t", "m"} and not any(item.repair for item in found)


def test_a_clock_in_milliseconds_is_advised_before_a_unit_of_the_acceleration() -> None:
    plain = rig()
    (finding,) = examine([replace(plain, x=None, v=None, t=1e3 * plain.t)]).findings
    assert finding.channel == "a" and finding.mend.index("t=ms") < finding.mend.index("F and a")
    assert "--unit a=mm/s2" not in finding.mend


def test_a_lead_of_few_degrees_below_a_resonance_tells_no_sign_and_a_small_force_no_mass() -> None:
    """Figures of a chirp below the resonance with a ring-down before it, seen through AC-coupled sensors."""
    plain = rig()
    seen = examine_force(plain)
    assert seen is not None
    lead = replace(seen, share=0.9968, reversed_share=0.99999, power=0.1, samples=20, mass=0.1, law=5.0)
    assert _judged_force(plain, replace(lead, correlation=0.3)) == []  # the motion leads, and gives out energy
    (told,) = _judged_force(plain, replace(lead, correlation=-0.3))  # above a resonance a lead would take it up
    assert told.slip == "swapped_sign"
    none = replace(seen, mass=0.1, mass_error=0.02, weight=1.0, free_share=0.95, shown=0.95)
    assert none.denies(MASS) and not replace(none, shown=0.3).denies(MASS)


@pytest.mark.parametrize("kept", ["xv", "va"])
def test_a_velocity_that_wanders_over_the_whole_recording_is_told(kept: str) -> None:
    """A fifth of its size, in two waves as long as the recording: an offset of an acceleration that was integrated."""
    plain = rig(60.0)
    assert plain.v is not None
    t = plain.t / plain.t[-1]
    wave = np.sin(2 * np.pi * t) + 0.5 * np.cos(5 * np.pi * t)
    drifting = replace(plain, v=plain.v + 0.2 * np.std(plain.v) * wave, **{n: None for n in "xa" if n not in kept})
    (finding,) = examine([drifting], MASS).findings
    assert (finding.slip, finding.channel) == ("drift", "v")
    assert examine([replace(drifting, v=plain.v)], MASS).findings == []


def test_a_force_and_a_displacement_that_are_exchanged_show_by_the_mass() -> None:
    plain = replace(rig(60.0), v=None, a=None)
    found = examine([replace(plain, F=plain.x, x=plain.F)], MASS).findings
    assert found and found[0].slip == "swapped_channels" and "F and x are exchanged" in found[0].sentence


def test_one_slow_stroke_denies_no_mass() -> None:
    """All of its motion is a function of the displacement: what of an acceleration is not, is noise, which has no
    mass."""
    rng, t = np.random.default_rng(2), np.arange(470) / 470.0
    w, size, mass = 2 * np.pi * 0.55, 1.3e-3, 4.0
    x, v, a = size * (1 - np.cos(w * t)), size * w * np.sin(w * t), size * w**2 * np.cos(w * t)
    force = mass * a + 1.3 * v + 700 * x + 0.3 * np.tanh(x / 1e-3)
    x, force = (u + 1e-3 * np.std(u) * rng.standard_normal(len(u)) for u in (x, force))
    found = examine([Recording("stroke", t, F=force, x=x)], mass).findings
    assert not [item for item in found if item.slip == "wrong_mass"]


def test_a_displacement_that_wanders_denies_no_mass() -> None:
    """Above a resonance inertia is most of the restoring force; x wanders by more than its motion, as an integral."""
    plain = rig(60.0)
    assert plain.x is not None and plain.F is not None and plain.a is not None
    t = plain.t / plain.t[-1]
    wander = 3 * np.std(plain.x) * (np.sin(2 * np.pi * t) + 2 * t**3)
    integral = replace(plain, x=plain.x + wander, v=None)
    assert not [item for item in examine([integral], MASS).findings if item.slip == "wrong_mass"]
    copy = replace(plain, F=plain.F - MASS * plain.a, v=None)  # the force behind the moving parts, well recorded
    assert [item.slip for item in examine([copy], MASS).findings] == ["wrong_mass"]


def test_a_damper_that_follows_the_place_denies_no_mass() -> None:
    """Near the resonance, by acceleration alone: inertia and restoring force are three times the force, and what no
    law takes of the restoring force, c x v on one side, is most of the force."""
    mass, stiffness, side = 12.0, 18210.0, 1e6
    t = np.arange(7500) / 500

    def force(at: Array) -> Array:
        return 5 * np.sin(2 * np.pi * 6.2 * at) + 4 * np.sin(2 * np.pi * 6.32 * at + 1)

    def moved(at: float, state: Array) -> list[Any]:
        x, v = state
        return [v, (force(np.asarray(at)) - 20 * v - stiffness * x - side * np.maximum(x, 0) * v) / mass]

    path = solve_ivp(moved, (0, t[-1] + 2), [0, 0], t_eval=t + 2, rtol=1e-8, atol=1e-10, max_step=0.005)
    a, rng = np.array(moved(t + 2, path.y)[1]), np.random.default_rng(0)
    noisy = {k: u + 0.02 * np.std(u) * rng.standard_normal(len(u)) for k, u in {"F": force(t + 2), "a": a}.items()}
    assert examine([Recording("rig", t, **noisy)], mass).findings == []


def test_the_noise_of_a_computed_acceleration_denies_no_mass() -> None:
    """A user took both derivatives of a displacement of 34 dB by a filter of eleven samples. Two tones on either side
    of the resonance: inertia is most of the force, and the noise of the acceleration louder than its motion."""
    rng, t, mass = np.random.default_rng(2), np.arange(3000) / 2300.0, 1.9
    w, size = 2 * np.pi * 7.3 * np.array([[1.0], [1.7]]), 1.6e-3 * np.array([[1.0], [0.6]])
    x, v, a = (np.sum(size * w**k * np.sin(w * t + k * np.pi / 2), axis=0) for k in range(3))
    force = mass * a + 13 * v + 6e3 * x + 2 * np.tanh(v / 2e-3)
    x, force = (u + 0.02 * np.std(u) * rng.standard_normal(len(u)) for u in (x, force))
    v, noisy = (savgol_filter(x, 11, 3, deriv=k, delta=1 / 2300) for k in (1, 2))
    assert np.std(noisy - a) > np.std(a)
    found = examine([Recording("derived", t, F=force, x=x, v=v, a=noisy)], mass).findings
    assert not [item for item in found if item.slip == "wrong_mass"]


@pytest.mark.parametrize("seed", [6, 18, 30, 53])
def test_a_force_of_two_tones_is_not_moved_to_where_it_fits_reversed(seed: int) -> None:
    """A contact that slips, with noise of 20 dB: half a beat earlier the reversed force fits better than the measured
    one as it stands, which drives the motion, and no clock is late by that."""
    rng, dt, n = np.random.default_rng(seed), 1 / 590, 5000
    t = np.arange(n) * dt
    low, high = (np.sin(2 * np.pi * rng.uniform(*band) * t + k) for k, band in enumerate(((3, 7.7), (7.7, 15))))
    force = rng.uniform(0.1, 0.3) * (low + high)
    true = {"m": 0.325, "B": 3.1, "Kl": 318.0, "Ks": 436.0, "fc": 0.177}
    rig = CompiledModel(compile_model("HystId.Oscillators.Jenkins"))
    moved = rig.simulate({"F": force}, dt, parameters=true, outputs=["x", "v", "a"], interpolation="cubic")
    noisy = {
        name: u + 0.1 * np.std(u) * rng.standard_normal(n)
        for name, u in {"F": force, "x": moved["x"], "a": moved["a"]}.items()
    }
    assert not examine([Recording("two", t, **noisy)], true["m"]).refusals


@pytest.mark.parametrize("seed", [0, 2])
def test_a_displacement_that_was_integrated_denies_no_sign(seed: int) -> None:
    """Near a resonance, by an acceleration with 1/f noise and its integrals: the displacement wanders, and a mass that
    moves the other way explains the force better than a spring does. The acceleration alone fits with its sign."""
    rng, dt = np.random.default_rng(seed), 1 / 2800
    t = np.arange(3669) * dt
    m, k, damping = 17.4, 17.4 * (2 * np.pi * 28.0) ** 2, 0.1 * 17.4 * 2 * np.pi * 28.0
    turns = np.cumsum(20 + 2 * rng.uniform(-1, 1) + 4 * np.sin(2 * np.pi * 0.4 * t + rng.uniform(0, 6))) * dt
    F = 20.0 * np.sin(2 * np.pi * turns)
    run = solve_ivp(
        lambda s, y: [y[1], (np.interp(s, t, F) - damping * y[1] - k * y[0]) / m],
        (0.0, t[-1]), [1e-5, 0.0], t_eval=t, rtol=1e-7, atol=1e-12, max_step=1e-3,
    )  # fmt: skip
    a = (F - damping * run.y[1] - k * run.y[0]) / m
    pink = np.fft.rfft(rng.standard_normal((2, len(t)))) / np.sqrt(np.maximum(np.arange(len(t) // 2 + 1), 1))
    slow = np.fft.irfft(pink, len(t))
    noisy = [
        u + 0.02 * np.std(u) * (0.8 * rng.standard_normal(len(t)) + 0.6 * w / np.std(w))
        for u, w in zip((F, a), slow, strict=True)
    ]
    high = butter(2, 2 * 1.4 * dt, btype="high", output="sos")
    v = sosfiltfilt(high, cumulative_trapezoid(noisy[1], dx=dt, initial=0))
    x = sosfiltfilt(high, cumulative_trapezoid(v, dx=dt, initial=0))
    assert not examine([Recording("run", t, F=noisy[0], x=x, v=v, a=noisy[1])], m).refusals


def low_passed(corner: float) -> Callable[[Array], Array]:
    """A filter to and fro; corner in cycles per sample."""
    return lambda values: np.asarray(sosfiltfilt(butter(4, 2 * corner, output="sos"), values))


FILTERS: dict[str, tuple[Callable[[Array], Array], int]] = {
    "low": (low_passed(0.125), 7600),
    "lower": (low_passed(0.1), 4000),
    "short": (low_passed(0.15), 3000),
}


@pytest.mark.parametrize("kind", FILTERS)
def test_noise_that_a_user_filtered_is_no_motion(kind: str) -> None:
    """In a steady tone the acceleration says nothing that the displacement does not, but for noise, which denies no
    mass; and a blow by a hammer is not earlier than what it moves."""
    smooth, n = FILTERS[kind]
    dt, mass, damping, stiffness = 1 / 4900, 3.5, 26.0, 3e5
    t, rng = np.arange(n) / 4900, np.random.default_rng(3)
    w = 2 * np.pi * 20.0
    x, v, a = (1e-4 * w**k * np.sin(w * t + k * np.pi / 2) for k in range(3))
    tone = mass * a + damping * v + stiffness * x + 1.5 * np.tanh(v / 1e-3)
    blows = np.sum([150 * np.exp(-(((t - at) / 0.002) ** 2)) for at in (0.1, 0.25, 0.4)], axis=0)
    moved = lsim(([1.0], [mass, damping, stiffness]), blows, t)[1]
    for force, motion in ((tone, x), (blows, moved)):
        F, seen = (u + 0.02 * np.std(u) * rng.standard_normal(n) for u in (force, motion))
        seen = smooth(seen)
        speed = np.gradient(seen, dt)
        for more in ({}, {"v": speed, "a": np.gradient(speed, dt)}):
            found = examine([Recording("filtered", t, F=F, x=seen, **more)], mass).findings
            assert not [item for item in found if item.slip in ("wrong_mass", "wrong_unit", "swapped_sign", "lag")]


SIZES = {"s": 1.0, "ms": 1e-3, "N": 1.0, "kN": 1e3, "lbf": 4.4482216, "mm": 1e-3, "in": 0.0254, "mm/s": 1e-3,
         "g": 9.80665}  # fmt: skip


def _without_units(units: dict[str, str]) -> Recording:
    """The rig as a file without units holds it, with some columns in others than SI."""
    plain = rig()
    changed = {name: getattr(plain, name) / SIZES[unit] for name, unit in units.items()}
    gone = {name: None for name in "xva" if name not in units}
    return replace(plain, **{**gone, **changed}, units=dict.fromkeys(units, ""))


@pytest.mark.parametrize(
    "units",
    [
        {"t": "ms", "F": "kN", "x": "mm", "a": "g"},
        {"t": "ms", "F": "kN", "x": "mm", "v": "mm/s", "a": "g"},
        {"t": "s", "F": "kN", "x": "mm", "a": "g"},
        {"t": "s", "F": "lbf", "x": "in", "a": "g"},
        {"t": "ms", "F": "N", "x": "mm", "a": "g"},
    ],
)
def test_columns_without_units_are_read_together(units: dict[str, str]) -> None:
    """Read one by one, some of them fit as cm/s2 and um, or as numbers of samples."""
    (told,) = examine([_without_units(units)], mass=MASS).findings
    true = " ".join(f"{name}={unit}" for name, unit in units.items() if SIZES[unit] != 1.0)
    assert told.slip == "wrong_unit" and f"or give --unit {true} if that is so" in told.mend and not told.repair


def test_columns_without_units_that_several_units_fit_are_left_to_the_user() -> None:
    """v over dx/dt is 1000 by the clock alone, and beside lengths in mm or inch as well."""
    (told,) = examine([_without_units({"t": "ms", "F": "kN", "x": "mm", "v": "mm/s"})]).findings
    assert "t in ms, x in mm and v in mm/s; or " in told.sentence and "do not tell which" in told.mend


def test_one_column_without_units_is_read_alone() -> None:
    units = dict.fromkeys(("t", "F", "x", "a"), "")
    plain = replace(rig(), v=None, units=units)
    assert examine([plain], mass=MASS).findings == []
    (told,) = examine([plain.with_channels({"a": plain.channel("a") / SIZES["g"]})], mass=MASS).findings
    assert told.repair == {"unit": "a=g"}


@pytest.mark.parametrize(("one", "other"), [("x", "v"), ("x", "a"), ("F", "x"), ("F", "a")])
def test_a_column_that_is_there_twice_is_named(one: str, other: str) -> None:
    plain = rig()
    (told,) = examine([plain.with_channels({one: plain.channel(other)})], mass=MASS).findings
    assert told.slip == "swapped_channels" and f"{one} and {other} hold the same numbers" in told.sentence


def test_a_wrong_sample_rate_looks_like_a_gain_where_two_channels_are_there() -> None:
    plain = replace(rig(), v=None)
    (told,) = examine([replace(plain, t=2 * plain.t)]).findings
    assert "a sample rate that is wrong by a factor of 2" in told.mend


@pytest.mark.parametrize("factor", [0.5, 2.0, 10.0])
def test_a_wrong_sample_rate_is_named_where_three_channels_are_there(factor: float) -> None:
    """v is wrong by the factor and a by its square: no unit of one channel, and no two gains, do that by chance."""
    plain = rig()
    (told,) = examine([replace(plain, t=factor * plain.t)], mass=MASS).findings
    assert told.channel == "t" and told.seen["times too large"] == pytest.approx(factor, rel=0.02)
    assert "sample rate" in told.sentence and not told.repair


@pytest.mark.parametrize(("one", "other"), [("x", "v"), ("v", "a")])
def test_neighbours_that_are_exchanged_beside_a_third_channel_are_named(one: str, other: str) -> None:
    """The third channel is a quarter of a period off either of them, as a derivative is, and no filter is at work."""
    t = np.arange(6000) / RATE
    force = 60 * np.sin(2 * np.pi * (t + 49 / 12 * t**2))
    code = CompiledModel(compile_model("HystId.Oscillators.Jenkins"))
    law = {"m": 1.2, "B": 10.0, "Kl": 1e4}
    moved = code.simulate({"F": force}, 1 / RATE, parameters=law, outputs=("x", "v", "a"), substeps=10)
    plain = _sensed(force, {name: moved[name] for name in "xva"}, RATE, 40.0, 6)
    assert examine([plain], 1.2).findings == []
    (told,) = examine([plain.with_channels({one: plain.channel(other), other: plain.channel(one)})], 1.2).findings
    assert (told.slip, told.channel) == ("swapped_channels", f"{one} and {other}")


@pytest.mark.parametrize("channel", ["x", "a"])
def test_the_force_tells_which_of_two_channels_is_wrong(channel: str) -> None:
    plain = replace(rig(), v=None)
    values = plain.channel(channel)
    (told,) = examine([plain.with_channels({channel: -values})], MASS).findings
    assert (told.slip, told.channel, told.repair) == ("swapped_sign", channel, {"reverse": channel})
    (told,) = examine([plain.with_channels({channel: np.roll(values, 12)})], MASS).findings
    assert (told.slip, told.channel) == ("lag", channel)
    assert told.seen["lag"] == pytest.approx(0.012, abs=5e-4)  # half a sample


@pytest.mark.parametrize("kept", ["xa", "va"])
def test_a_filter_of_the_acceleration_makes_no_force_early(kept: str) -> None:
    plain = rig()
    plain = replace(plain, **{name: None for name in "xv" if name not in kept})
    a = sosfilt(butter(2, 60.0, fs=RATE, output="sos"), plain.channel("a"))
    assert [(f.slip, f.channel) for f in examine([replace(plain, a=a)], MASS).findings] == [("filtered", "a")]


def test_a_unit_and_a_lag_are_told_together() -> None:
    """The mass weighs the channel that the acceleration is taken from: x, where a is late."""
    plain = replace(rig(), v=None)
    late = plain.with_channels({"x": 1e3 * plain.channel("x"), "a": np.roll(plain.channel("a"), 12)})
    unit, lag = examine([late], MASS).findings
    assert unit.repair == {"unit": "x=mm"} and (lag.slip, lag.channel) == ("lag", "a")


@pytest.mark.parametrize("seed", [2, 3])
def test_one_filter_is_no_lag_in_other_pairs(seed: int) -> None:
    """300 samples: the filter of a shows beside v, and beside x a lag would do as well."""
    rng, dt, n = np.random.default_rng(4), 0.004, 300
    lines, hertz = np.exp(2j * np.pi * rng.random(n // 2 + 1)), np.fft.rfftfreq(n, dt)
    force = np.fft.irfft(np.where((hertz >= 2) & (hertz <= 40), lines, 0.0), n)
    force *= 60.0 / np.std(force)
    rig = CompiledModel(compile_model("HystId.Oscillators.BoucWen"))
    law = {"m": 3.0, "B": 15.0, "Kl": 4e4}
    moved = rig.simulate({"F": force}, dt, parameters=law, outputs=("x", "v", "a"), substeps=10)
    plain = _sensed(force, {name: moved[name] for name in "xva"}, 1 / dt, 40.0, seed)
    a = sosfilt(butter(2, 70.0, fs=1 / dt, output="sos"), plain.channel("a"))
    assert [(f.slip, f.channel) for f in examine([replace(plain, a=a)], 3.0).findings] == [("filtered", "a")]


def test_beside_exchanged_columns_no_unit_is_told() -> None:
    """After an exchange the sizes follow from one frequency only: in g, feet fitted as well."""
    plain = replace(rig(), v=None)
    (told,) = examine(
        [plain.with_channels({"x": plain.channel("a") / SIZES["g"], "a": plain.channel("x")})], MASS
    ).findings
    assert (told.slip, told.channel) == ("swapped_channels", "x and a") and "check again" in told.mend


def test_a_force_in_the_column_of_a_motion_is_no_gain() -> None:
    """Beside a second slip, F for x is not named; but a ratio that changes with frequency is no sensor's factor."""
    plain = replace(rig(), v=None)
    found = examine([plain.with_channels({"F": 1e3 * plain.channel("x"), "x": plain.channel("F")})], MASS).findings
    assert [(f.slip, f.channel) for f in found] == [("not_one_motion", "a")] and "F" in found[0].mend


def test_which_of_two_channels_is_late_is_left_open_without_a_force() -> None:
    plain = replace(rig(), v=None, F=None)
    (told,) = examine([replace(plain, x=np.roll(plain.channel("x"), 12))]).findings
    assert told.slip == "lag" and "which of the two" in told.mend and not told.repair


def test_ratios_that_no_slip_explains_are_told_as_such() -> None:
    """v and a with factors of their own: a unit and a gain, or a rate and a gain, come near to anything."""
    plain = rig()
    found = examine([plain.with_channels({"v": 7 * plain.channel("v"), "a": 17 * plain.channel("a")})]).findings
    assert [f.slip for f in found] == ["not_one_motion"] and "several things are wrong" in found[0].mend


def test_a_channel_that_follows_no_other_is_told_as_such() -> None:
    """x of another structure beside v and a: others are there, and say nothing about it."""
    other = np.random.default_rng(3).standard_normal(N) * 1e-4
    (told,) = (s for s in examine([replace(rig(), x=other)], MASS).undecided("x"))
    assert "it does not follow the other channels of the motion" in told
    (told,) = (s for s in examine([replace(rig(), v=None, a=None, F=None)]).undecided("x") if "unit" not in s)
    assert "no other channel of the motion is there" in told


def test_a_recording_that_is_too_short_is_told_as_not_examined() -> None:
    """63 samples: neither is anything left open about single channels, nor does nothing speak against them."""
    found = examine([rig().part(slice(0, 63))], MASS)
    assert found.findings == [] and not found.undecided("tFxvam")
    assert "rig was not examined: of 63 samples nothing can be compared; at least 64 are needed" in found.summary()
    assert "nothing speaks against" not in found.summary()
    assert "not examined" not in examine([rig().part(slice(0, 64))], MASS).summary()


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_mass_that_the_force_contradicts_is_a_note(factor: float) -> None:
    """No unit is twice another one, and fixtures may be heavy: nothing is refused, and both masses are told."""
    (told,) = examine([rig()], factor * MASS).findings
    assert (told.slip, told.severity) == ("wrong_mass", "note")
    assert told.seen == pytest.approx({"apparent mass": MASS, "given mass": factor * MASS}, rel=0.03)
    assert "says a mass of 2.498 kg" in told.sentence and f"not {factor * MASS:g} kg" in told.sentence
    assert "give --mass 2.498" in told.mend
    assert examine([rig()], 1.4 * MASS).findings == []


@pytest.mark.parametrize(("seed", "K", "band", "tau"), [(6, 15500.0, (6, 10), 1.5), (0, 3e4, (6, 10), 1.5)])
def test_a_mass_that_nothing_shows_exchanges_nothing(
    seed: int, K: float, band: tuple[float, float], tau: float
) -> None:
    """F and x of a rig with dry friction, recorded from mid-motion on while a burst dies away: as the columns are
    called, no stretch tells a mass; the other way any mass is within the errors, and only a spring is seen."""
    n, before, sub, fs, rng = 2800, 700, 4, 1500.0, np.random.default_rng(seed)
    m, B, Ks, fc = 4.0, 8.0, 21000.0, 1.2
    t = (np.arange(n + before) - before) / fs
    F = sosfilt(butter(2, band, "band", fs=fs, output="sos"), rng.standard_normal(n + before))
    F = 1.3 * F / np.std(F[before:]) * np.exp(-t / tau)
    x = np.zeros(n + before)
    u = v = z = 0.0
    for i, f in enumerate(F):
        x[i] = u
        for _ in range(sub):
            v += (f - B * v - K * u - z) / m / fs / sub
            u += v / fs / sub
            z = min(max(z + Ks * v / fs / sub, -fc), fc)  # an elastic slider
    channels = {name: values[before:] for name, values in {"F": F, "x": x}.items()}
    noisy = {name: y + 1e-3 * np.std(y) * rng.standard_normal(n) for name, y in channels.items()}
    assert not examine([Recording("burst", t[before:], **noisy)], m).findings


def test_an_exciter_that_drags_along_is_not_reversed_by_knocks() -> None:
    """A decay that is knocked anew: what comes after the last knock holds little of the force, and tells no sign."""
    drag, rng, t = 1.0, np.random.default_rng(0), np.arange(N) / RATE
    A = [[0.0, 1.0], [-STIFFNESS / MASS, -(DAMPING + drag) / MASS]]
    blow = np.where(abs(t - 3.0) < 0.01, 10 * np.cos(np.pi * (t - 3.0) / 0.02) ** 2, 0.0)
    system = (A, [[0.0], [1.0]], [[1.0, 0.0], [0.0, 1.0], A[1]], [[0.0], [0.0], [1.0]])
    x, v, a = lsim(system, blow, t, X0=[1e-3, 0.0])[1].T
    channels = {"F": -drag * v, "x": x, "v": v, "a": a}
    noisy = {k: u + 1e-3 * np.std(u) * rng.standard_normal(N) for k, u in channels.items()}
    assert examine([Recording("decay", t, **noisy, origin=dict.fromkeys(noisy, "measured"))]).findings == []
    driven = rig(60.0)
    assert driven.F is not None
    assert examine([replace(driven, F=-driven.F)]).findings[0].slip == "swapped_sign"
