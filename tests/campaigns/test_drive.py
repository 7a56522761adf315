"""Drives as laboratories declare them, channels that are derived from others, and zeros of sensors."""

import numpy as np
import pytest
from campaign_folder import CHANNELS, FIT, GAUGE, motion, toml_text, write

from twin.campaigns.campaign import read_campaign
from twin.errors import InputError

# 0.5 * 10 * 0.02 / 2 = 0.05 N m/V at rest, and 0.05 * 10 * 0.02 = 0.01 N m s/rad of back-EMF.
CONSTANTS = "resistance = 2.0\ntorque_constant = 0.02\ngear_ratio = 10\nefficiency = 0.5\n"
VOLTS = CHANNELS | {"torque_command": 'unit = "V"'}


def campaign(folder, drive="", channels=None):
    folder.mkdir(exist_ok=True)
    return read_campaign(write(folder, toml_text(channels or CHANNELS) + drive))


def test_a_voltage_drive_is_a_gain_and_a_back_emf(tmp_path):
    plain = campaign(tmp_path / "a")
    volts = campaign(tmp_path / "b", f'[drive]\nkind = "voltage"\nlimit = 3.0\n{CONSTANTS}', VOLTS)
    expected = 0.05 * plain.fit[0]["torque_command"]
    np.testing.assert_allclose(volts.fit[0]["torque_command"], expected)
    assert volts.rig["torque_limit"] == pytest.approx(0.15)
    assert volts.effects["torque-gain"] == {"gain": 1.0}
    assert volts.effects["viscous-friction"]["viscous"] == pytest.approx(0.01)
    assert volts.effect_errors["torque-gain"]["gain"] == pytest.approx(0.1)
    assert volts.effect_errors["viscous-friction"]["viscous"] == pytest.approx(0.01 * np.hypot(0.1, 0.1))
    assert (plain.effects, plain.effect_errors) == ({}, {})


def test_a_command_and_its_limit_may_be_in_millivolts(tmp_path):
    drive, millivolts = (
        f'[drive]\nkind = "voltage"\nlimit = 3000\n{CONSTANTS}',
        {"torque_command": 'unit = "mV"'},
    )
    true, volts = motion(), motion() | {"torque_command": 1e3 * motion()["torque_command"]}
    toml = toml_text(CHANNELS | millivolts, (FIT,)) + drive
    declared = read_campaign(write(tmp_path, toml, push=volts | {"hub_angle": 0.05 * true["hub_angle"]}))
    expected = 0.05 * true["torque_command"]
    np.testing.assert_allclose(declared.fit[0]["torque_command"], expected, atol=1e-9)
    assert declared.rig["torque_limit"] == pytest.approx(0.15)


def test_a_current_drive_has_no_back_emf(tmp_path):
    amperes = CHANNELS | {"torque_command": 'unit = "A"'}
    drive = f'[drive]\nkind = "current"\nefficiency_uncertainty = 0.03\n{CONSTANTS}'
    declared = campaign(tmp_path, drive, amperes)
    assert list(declared.effects) == ["torque-gain"]
    assert declared.effect_errors["torque-gain"]["gain"] == pytest.approx(0.03)


def test_a_command_in_another_unit_than_that_of_the_drive_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"torque_command.unit is 'N\*m'; expected 'V'"):
        campaign(tmp_path, f'[drive]\nkind = "voltage"\n{CONSTANTS}')


def test_a_motor_behind_a_gear_gives_the_hub_angle(tmp_path):
    hub = campaign(tmp_path / "a").fit[0]["hub_angle"]
    motor = {n: c for n, c in CHANNELS.items() if n != "hub_angle"}
    motor["motor_angle"] = 'column = "hub_angle"\nunit = "rad"\nnoise = 1e-3'
    behind = campaign(tmp_path / "b", "[drive]\ngear_ratio = 10\n", motor)
    np.testing.assert_allclose(behind.fit[0]["hub_angle"], hub / 10)
    assert behind.sensors["hub_angle"].noise == pytest.approx(1e-4)


def test_time_in_milliseconds_is_converted(tmp_path):
    seconds = read_campaign(write(tmp_path)).fit[0].time
    push, pull = motion(), motion(peak=-0.1, seed=1)
    toml = toml_text(CHANNELS | {"time": 'unit = "ms"'})
    fast = write(
        tmp_path, toml, push=push | {"time": 1e3 * push["time"]}, pull=pull | {"time": 1e3 * pull["time"]}
    )
    np.testing.assert_allclose(read_campaign(fast).fit[0].time, seconds)


def test_the_zero_of_a_gauge_is_unknown_unless_it_is_certain(tmp_path):
    certain = CHANNELS | {"strain_base": f"{GAUGE}\noffset_uncertainty = 0.0"}
    assert campaign(tmp_path / "a").sensors["strain_base"].has_unknown_zero
    assert not campaign(tmp_path / "b", channels=certain).sensors["strain_base"].has_unknown_zero
    assert not campaign(tmp_path / "a").sensors["hub_angle"].has_unknown_zero


def test_the_nominal_gain_of_a_voltage_is_known_where_no_drive_is_declared(tmp_path):
    volts = CHANNELS | {"torque_command": 'unit = "V"\ngain = 0.05'}
    assert campaign(tmp_path / "a", channels=volts).torque_per_volt == 0.05
    assert campaign(tmp_path / "b").torque_per_volt is None
    declared = campaign(tmp_path / "c", f'[drive]\nkind = "voltage"\n{CONSTANTS}', VOLTS)
    assert declared.torque_per_volt is None


@pytest.mark.parametrize(
    ("drive", "expected"),
    [
        (f"[drive]\n{CONSTANTS}", '"voltage", as the command is in V'),
        ("[drive]\n", '"voltage", as the command is in V'),
    ],
)
def test_a_drive_of_a_motor_needs_its_kind(tmp_path, drive, expected):
    with pytest.raises(InputError, match=f"drive.kind is missing; expected {expected}"):
        campaign(tmp_path, drive, VOLTS)


def test_without_a_gain_a_drive_is_proposed(tmp_path):
    with pytest.raises(InputError, match=r'gain is missing; .* or a table \[drive\] with kind = "voltage"'):
        campaign(tmp_path, "", VOLTS)


def test_a_gain_before_a_voltage_drive_is_told(tmp_path):
    volts = VOLTS | {"torque_command": VOLTS["torque_command"] + "\ngain = 0.1"}
    declared = campaign(tmp_path, f'[drive]\nkind = "voltage"\n{CONSTANTS}', volts)
    assert any("counts as 0.1 V at the motor" in note for note in declared.warnings)
