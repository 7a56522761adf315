"""What a campaign declares of its sensors' gains and delays, and a tachometer beside the hub angle."""

import numpy as np
import pytest
from campaign_folder import CHANNELS, GAUGE, INERTIA, motion, toml_text, write

from twin.campaigns.campaign import read_campaign
from twin.campaigns.check_channels import check_signs_and_units
from twin.campaigns.defects import without_defects
from twin.campaigns.readings import without_outliers
from twin.errors import InputError
from twin.recording import Recording, Sensor
from twin.residuals.prepared import prepare
from twin.rigs import preset

TACHO = 'unit = "rpm"\nnoise = 0.1'


def with_rate(rate=None, **more):
    """The columns of a recording with a tachometer [rev/min]."""
    columns = motion(**more)
    peak = more.get("peak", 0.1)
    turning = peak / (2 * np.pi * INERTIA) * (1 - np.cos(2 * np.pi * columns["time"]))
    noise = 0.1 * np.random.default_rng(7).standard_normal(len(turning))
    return columns | {
        "hub_rate": turning * 30 / np.pi + noise if rate is None else rate * np.ones_like(turning)
    }


def campaign(folder, channels, **more):
    return read_campaign(write(folder, toml_text(channels), **more))


def test_gain_and_delay_are_certain_unless_declared(tmp_path):
    declared = f"{GAUGE}\ngain_uncertainty = 0.02\ndelay_uncertainty = 0.001"
    read = campaign(tmp_path, CHANNELS | {"strain_base": declared}).sensors
    assert (read["strain_base"].gain_uncertainty, read["strain_base"].delay_uncertainty) == (0.02, 0.001)
    assert (read["hub_angle"].gain_uncertainty, read["hub_angle"].delay_uncertainty) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("channel", "lines", "told"),
    [
        (
            "hub_reference",
            'column = "hub_angle2"\nunit = "rad"\ngain_uncertainty = 0.1',
            "gain_uncertainty is not used",
        ),
        (
            "strain_base",
            f"{GAUGE}\ngain_uncertainty = 5",
            "gain_uncertainty is 5, which is 500 % of the gain",
        ),
        (
            "strain_base",
            f"{GAUGE}\ndelay_uncertainty = 2",
            "delay_uncertainty is 2 s; delays of more than 0.05 s",
        ),
    ],
)
def test_what_is_hardly_meant_is_noted(tmp_path, channel, lines, told):
    columns = {name: motion(seed=seed) for name, seed in (("push", 0), ("pull", 1))}
    files = {name: c | {"hub_angle2": c["hub_angle"]} for name, c in columns.items()}
    notes = campaign(tmp_path, CHANNELS | {channel: lines}, **files).warnings
    assert any(f"channels.{channel}.{told}" in note for note in notes)


def test_the_gain_of_a_tip_angle_is_none_of_the_deflection(tmp_path):
    tip = {"tip_angle": 'unit = "rad"\nnoise = 1e-4\ngain_uncertainty = 0.1'}
    files = {name: motion(seed=seed) for name, seed in (("push", 0), ("pull", 1))}
    files = {n: c | {"tip_angle": c["hub_angle"] - 1e-3 * c["torque_command"]} for n, c in files.items()}
    read = campaign(tmp_path, CHANNELS | tip, **files)
    assert read.sensors["tip_deflection"].gain_uncertainty == 0
    assert any("channels.tip_angle.gain_uncertainty is not used" in note for note in read.warnings)


def test_a_tachometer_is_a_channel(tmp_path):
    files = {"push": with_rate(), "pull": with_rate(peak=-0.1, seed=1)}
    read = campaign(tmp_path, CHANNELS | {"hub_rate": TACHO}, **files)
    [fit] = read.fit
    assert "hub_rate" in fit.measured()
    np.testing.assert_allclose(fit["hub_rate"], files["push"]["hub_rate"] * np.pi / 30, rtol=1e-6)
    assert read.sensors["hub_rate"].noise == pytest.approx(0.1 * np.pi / 30)
    assert read.sensors["hub_rate"].has_unknown_zero
    assert not any("hub_rate" in note for note in read.warnings)


def test_a_rate_is_no_angle(tmp_path):
    channels = {n: c for n, c in CHANNELS.items() if n != "hub_angle"} | {"hub_rate": TACHO}
    with pytest.raises(InputError, match="hub_angle is missing.*hub_rate does not replace it"):
        campaign(tmp_path, channels, push=with_rate(), pull=with_rate(seed=1))


def test_a_tachometer_that_never_changes_while_the_hub_turns_is_dead(tmp_path):
    files = {"push": with_rate(0.0), "pull": with_rate(0.0, peak=-0.1, seed=1)}
    with pytest.raises(InputError, match=r"channels\.hub_rate never changes"):
        campaign(tmp_path, CHANNELS | {"hub_rate": TACHO}, **files)


def turning(rate_gain=1.0):
    """A hub that turns to and fro, pausing, with a tachometer; 40 s."""
    time = 0.004 * np.arange(10000)
    rate = np.maximum(np.sin(2 * np.pi * 0.25 * time), -0.5)
    angle = np.r_[0.0, np.cumsum((rate[1:] + rate[:-1]) / 2 * 0.004)]
    acceleration = np.gradient(rate, time)
    channels = {"torque_command": 0.0284 * acceleration, "hub_angle": angle, "hub_rate": rate_gain * rate}
    return Recording("slow.csv", time, channels)


def test_a_tachometer_as_fast_as_the_angle_passes():
    check_signs_and_units([turning(1.3)], {}, preset("bossi2009"))


@pytest.mark.parametrize(
    ("gain", "told"),
    [
        (-1.0, "wrong way round in slow.csv: it falls where hub_angle"),
        (30 / np.pi, "some 10 times too large"),
    ],
)
def test_a_tachometer_of_another_sign_or_in_revolutions_per_minute_is_named(gain, told):
    with pytest.raises(InputError, match=rf"channels\.hub_rate: .*{told}"):
        check_signs_and_units([turning(gain)], {}, preset("bossi2009"))


def test_kinks_of_a_rate_are_no_outliers_but_lone_readings_are():
    time = 0.002 * np.arange(2000)
    # A hub that the motor speeds up at 300 rad/s^2, stops at 600 rad/s^2, and that rests.
    rate = np.clip(np.minimum(300 * (time % 0.5), 600 * (0.1 - time % 0.5)), 0.0, None)
    noisy = rate + 0.01 * np.random.default_rng(0).standard_normal(len(time))
    found, notes = without_outliers(Recording("a", time, {"hub_rate": noisy}), {"hub_rate": 0.01})
    assert notes == []
    noisy[777] += 0.5
    found, notes = without_outliers(Recording("a", time, {"hub_rate": noisy}), {"hub_rate": 0.01})
    assert notes == ["a: 1 outlier in hub_rate left out"]
    assert np.flatnonzero(np.isnan(found["hub_rate"])).tolist() == [777]


def test_a_tachometer_without_noise_that_rests_is_no_defect():
    time = 0.002 * np.arange(3000)
    rate = np.round(np.clip(np.sin(2 * np.pi * 0.5 * time), 0.0, None), 2)
    run = Recording("a", time, {"torque_command": np.zeros_like(time), "hub_rate": rate})
    assert without_defects([run], {"hub_rate": Sensor("hub_rate")})[1] == []


def test_a_tachometer_tells_nothing_of_a_locked_hub():
    time = 0.002 * np.arange(500)
    strain = 1e-4 * np.cos(2 * np.pi * 2 * time)
    run = Recording("a", time, {"hub_rate": 0.02 + 0 * time, "strain_base": strain}, clamped=True)
    assert prepare(run, {"hub_rate": 0.01, "strain_base": 1e-6})[0].channels == ("strain_base",)
