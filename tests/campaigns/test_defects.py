"""Defects that a channel's readings show: each is found, listed and left out; nothing is found where there is none."""

from pathlib import Path

import numpy as np
import pytest
from marks import slow_except

import twin
from twin.campaigns.campaign import read_campaign
from twin.campaigns.defects import without_defects
from twin.recording import Recording, Sensor
from twin.virtual_rig.experiments import bang_bang, free_vibration
from twin.virtual_rig.rig import Rig
from twin.virtual_rig.sensors import DIRT, Sensors, soiled

TIME = np.arange(0.0, 6.0, 2e-3)
WITHIN = (TIME > 2.0) & (TIME < 2.7)
NOISE = {"strain_base": 2e-6, "hub_angle": 3e-4, "motor_torque": 1e-3}


def noise(channel, seed=0):
    return NOISE[channel] * np.random.default_rng(seed).standard_normal(len(TIME))


def recording(channel, values, command=None, time=TIME):
    command = np.zeros(len(TIME)) if command is None else command
    return Recording("run.csv", time, {"torque_command": command, channel: values})


def cleaned(channel, values, declared=True, **more):
    sensor = Sensor(channel, NOISE[channel] if declared else None, 0.02, 1e-3)
    [clean], notes = without_defects([recording(channel, values, **more)], {channel: sensor})
    return clean[channel], notes


def vibration(frequency=7.0, size=3e-4):
    """A strain that vibrates, through a converter of 1e-7."""
    return np.round(size * np.sin(2 * np.pi * frequency * TIME) + noise("strain_base"), 7)


def swing(step=1e-4):
    """A hub that rests for a second, then swings."""
    angle = 0.4 * (1 - np.cos(3 * np.maximum(TIME - 1, 0))) + noise("hub_angle")
    return step * np.rint(angle / step)


@pytest.mark.parametrize("declared", [True, False])
def test_a_frozen_strain_is_left_out(declared):
    values = vibration()
    values[WITHIN] = values[WITHIN][0]
    clean, notes = cleaned("strain_base", values, declared)
    np.testing.assert_array_equal(np.isnan(clean), WITHIN)
    [note] = notes
    assert note.startswith("run.csv: strain_base stays at ")
    assert note.endswith("from 2.00 to 2.70 s; left out there")


def test_a_frozen_hub_is_left_out():
    values = swing()
    values[WITHIN] = values[WITHIN][0]
    clean, [note] = cleaned("hub_angle", values)
    assert np.isnan(clean[WITHIN]).all()
    # A reading beside the stretch may equal it by chance.
    assert np.isnan(clean[~WITHIN]).sum() <= 2
    assert " rad from 2.00 to 2.70 s" in note


def test_a_channel_that_freezes_behind_a_coarse_converter_jumps_on_release():
    values = 1e-3 * np.rint(8 * np.sin(0.2 * TIME) / 1e-3)
    values[WITHIN] = values[WITHIN][0]
    clean, [note] = cleaned("hub_angle", values)
    np.testing.assert_array_equal(np.isnan(clean), WITHIN)
    assert "from 2.00 to 2.70 s" in note


@pytest.mark.parametrize("step", [1e-7, 1e-5])
def test_a_saturated_converter_is_left_out(step):
    values = step * np.rint(vibration(3.0) / step)
    full_scale = step * np.rint(2e-4 / step)
    beyond = np.abs(values) >= full_scale
    values = np.clip(values, -full_scale, full_scale)
    if step > NOISE["strain_base"]:
        values = step * np.rint(np.clip(1e-2 * np.sin(20 * TIME), -5e-3, 5e-3) / step)
        beyond = np.abs(values) == np.abs(values).max()
    clean, [note] = cleaned("strain_base", values)
    np.testing.assert_array_equal(np.isnan(clean), beyond)
    assert note.startswith("run.csv: strain_base is saturated at ")


def test_a_bad_segment_is_left_out():
    values = vibration()
    values[WITHIN] += 15 * noise("strain_base", 1)[WITHIN]
    clean, [note] = cleaned("strain_base", values)
    assert np.mean(np.isnan(clean[WITHIN])) > 0.97
    assert np.isnan(clean[~WITHIN]).sum() < 8
    assert "times its usual noise from 2.0" in note


@pytest.mark.parametrize("step", [0.0, 1e-4, 1e-3, 1e-2])
def test_a_hub_that_rests_behind_any_converter_is_sound(step):
    angle = swing(1e-9) if step == 0 else swing(step)
    angle[TIME > 4.5] = angle[-1] if step >= 1e-3 else angle[TIME > 4.5]
    assert cleaned("hub_angle", angle)[1] == []
    assert cleaned("hub_angle", angle, declared=False)[1] == []


SOUND = {
    "slow ramp": ("hub_angle", lambda: 1e-3 * np.rint(0.02 * TIME / 1e-3)),
    "noise-free": ("strain_base", lambda: 1e-4 * np.sin(20 * np.maximum(TIME - 1, 0)) ** 2),
    "wiper noisy in motion alone": (
        "hub_angle",
        lambda: np.round(swing() - np.where((TIME < 1) | (TIME > 4), swing(), 0) + 0.8 * (TIME > 4), 4),
    ),
    "amplifier that clips before the noise": (
        "strain_base",
        lambda: np.round(np.clip(3e-4 * np.sin(40 * TIME), -1e-4, 1e-4) + noise("strain_base"), 7),
    ),
    "vibration of 45 Hz for a while": (
        "strain_base",
        lambda: vibration() + 3e-4 * WITHIN * np.sin(2 * np.pi * 45 * TIME),
    ),
    "vibration of 120 Hz for a while": (
        "strain_base",
        lambda: vibration() + 1e-4 * WITHIN * np.sin(2 * np.pi * 120 * TIME),
    ),
    "four significant digits": (
        "strain_base",
        lambda: np.array([float(f"{v:.4g}") for v in 1e-4 * np.exp(-TIME) * np.sin(9 * TIME)]),
    ),
    "square wave through a coarse converter": ("strain_base", lambda: 1e-4 * np.sign(np.sin(4 * TIME))),
}


@pytest.mark.parametrize(("channel", "values"), SOUND.values(), ids=SOUND)
@pytest.mark.parametrize("declared", [True, False])
def test_what_only_looks_like_a_defect_is_sound(channel, values, declared):
    assert cleaned(channel, values(), declared)[1] == []


def test_a_torque_that_nothing_is_asked_of_is_constant():
    command = np.where((TIME > 1) & (TIME < 2), 0.1, 0.0)
    torque = np.where(command > 0, command + noise("motor_torque"), 0.0)
    assert cleaned("motor_torque", torque, command=command)[1] == []


def test_jittered_stamps_of_a_fast_slew_are_no_noise():
    stamps = TIME + 2.4e-4 * np.clip(np.random.default_rng(3).standard_normal(len(TIME)), -3, 3)
    slew = 3 * np.tanh(4 * (stamps - 3)) + noise("hub_angle")
    [clean], notes = without_defects(
        [recording("hub_angle", slew, time=stamps)], {"hub_angle": Sensor("hub_angle", NOISE["hub_angle"])}
    )
    assert notes == []
    assert np.isfinite(clean["hub_angle"]).all()


def test_missing_rows_and_readings_are_counted():
    kept = np.ones(len(TIME), dtype=bool)
    kept[[100, 101, 500]] = False
    values = vibration()
    values[200:205] = np.nan
    short = Recording(
        "run.csv", TIME[kept], {"torque_command": np.zeros(kept.sum()), "strain_base": values[kept]}
    )
    _, notes = without_defects([short], {"strain_base": Sensor("strain_base", 2e-6, 0.02, 1e-3)})
    assert notes == ["run.csv: 3 rows, 5 readings of strain_base are missing"]


def of_campaign(folder):
    campaign = read_campaign(folder)
    return without_defects((*campaign.fit, *campaign.holdout()), campaign.sensors)


def test_nothing_is_found_in_the_demo_campaign():
    assert of_campaign(Path(twin.__file__).parent / "data" / "demo-rig")[1] == []


@pytest.mark.parametrize(
    ("kind", "said"),
    slow_except(
        [("stuck", "stays at"), ("saturated", "saturated at"), ("bad-segment", "usual noise")], "stuck"
    ),
)
def test_every_kind_is_found_in_campaigns_of_the_virtual_rig(rig_campaign, kind, said):
    draw = np.random.default_rng(1)
    plan = [bang_bang(Rig(), Sensors(), draw, 45.0), free_vibration(Rig(), Sensors(), draw)]
    assert of_campaign(rig_campaign({}, 31, experiments=plan).folder)[1] == []
    dirty = rig_campaign({}, 31, experiments=plan, dirty=(kind,))
    runs, notes = of_campaign(dirty.folder)
    for run in runs:
        broken = np.isin(run.time, dirty.truth.defects[run.name][kind])
        [channel] = [c for c in run.measured() if np.isnan(run[c]).any()]
        assert np.mean(np.isnan(run[channel][broken])) > 0.9
        assert np.isnan(run[channel][~broken]).sum() < 10
        [note] = [n for n in notes if n.startswith(run.name) and said in n]
        assert channel in note


def test_new_kinds_of_dirt_leave_the_others_as_they_were():
    old, new = ("spikes", "missing-fields", "dropped-rows"), ("stuck", "saturated", "bad-segment")
    assert set(old + new + ("jitter",)) == set(DIRT)
    table = {"time": TIME, "torque_command": np.zeros(len(TIME)), "strain_base": vibration()}
    table |= {"hub_angle": swing(), "strain_mid": vibration(5.0)}
    runs = [soiled(table, Sensors(), kinds, np.random.default_rng(5))[1] for kinds in (old, old + new)]
    assert set(runs[1]) == set(old + new)
    assert {kind: runs[1][kind] for kind in old} == runs[0]
