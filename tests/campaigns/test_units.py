"""Units: factors against their definitions, and what is refused."""

import math
import subprocess
import sys

import numpy as np
import pytest
from campaign_folder import CHANNELS, FIT, motion, toml_text, write
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.campaigns import units
from twin.campaigns.campaign import read_campaign
from twin.errors import InputError
from twin.recording import CHANNEL_UNITS


@pytest.mark.parametrize(
    ("channel", "unit", "expected"),
    [
        ("hub_angle", "rad", 1.0),
        ("hub_angle", "deg", math.pi / 180),
        ("hub_reference", "deg", math.pi / 180),
        ("strain_base", "1", 1.0),
        ("strain_mid", "microstrain", 1e-6),
        ("tip_deflection", "mm", 1e-3),
        ("tip_acceleration", "m/s^2", 1.0),
        ("torque_command", "N*m", 1.0),
        ("time", "s", 1.0),
    ],
)
def test_factor_to_si(channel, unit, expected):
    assert units.scale(channel, unit) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize("channel", CHANNEL_UNITS)
@pytest.mark.parametrize("unit", ["V", "A"])
def test_gain_of_volts_and_amperes_is_si(channel, unit):
    assert units.scale(channel, unit) == 1.0


PAIRS = [(a, b) for a in units.UNITS for b in units.UNITS if units.convertible(a, b)]


@given(pair=st.sampled_from(PAIRS), value=st.floats(-1e9, 1e9))
def test_a_value_comes_back_from_another_unit(pair, value):
    unit, other = pair
    back = value * units.factor(unit, other) * units.factor(other, unit)
    assert back == pytest.approx(value, rel=1e-15, abs=0)


HALF_THICKNESS = 0.001  # m
IN_SI = {
    "rad": 1,
    "deg": math.pi / 180,
    "N*m": 1,
    "1": 1,
    "microstrain": 1e-6,
    "1/m": HALF_THICKNESS,
    "V": 1,
    "A": 1,
}
SIZES = st.floats(0.1, 10.0) | st.floats(-10.0, -0.1)


@settings(max_examples=30)
@given(
    recorded=st.fixed_dictionaries(
        {c: st.tuples(st.sampled_from(units.allowed(c)), SIZES, st.floats(-5.0, 5.0)) for c in CHANNELS}
    )
)
def test_recordings_in_any_unit_with_any_gain_and_offset_are_read_in_si(tmp_path_factory, recorded):
    true, channels, room = motion(samples=200), {}, {}
    push = dict(true)
    for channel, (unit, gain, share) in recorded.items():
        values = true[channel] / (gain * IN_SI[unit])
        offset = share * np.abs(values).max()
        push[channel] = values + offset
        channels[channel] = f'unit = "{unit}"\ngain = {gain!r}\noffset = {float(offset)!r}'
        if units.is_strain(channel):
            channels[channel] += f"\nposition = 0.02\nhalf_thickness = {HALF_THICKNESS}"
        # The file has nine digits, to half of the last, of values up to six times as large.
        room[channel] = 6 * 5e-9 * np.abs(true[channel]).max()
    folder = tmp_path_factory.getbasetemp() / "units"
    folder.mkdir(exist_ok=True)
    [read] = read_campaign(write(folder, toml_text(channels, (FIT,)), push=push)).fit
    for channel, atol in room.items():
        np.testing.assert_allclose(read[channel], true[channel], rtol=0, atol=atol)


def test_curvature_is_strain_over_half_thickness():
    assert units.scale("strain_base", "1/m", half_thickness=0.0008) == 0.0008


@pytest.mark.parametrize("channel", CHANNEL_UNITS)
def test_si_unit_is_allowed_and_first(channel):
    assert units.allowed(channel)[0] == CHANNEL_UNITS[channel]


@pytest.mark.parametrize(
    ("channel", "unit", "right"),
    [
        ("hub_angle", "m", "rad, deg"),
        ("hub_angle", "rad/s", "rad, deg"),
        ("hub_angle", "1", "rad, deg"),
        ("strain_base", "deg", "1, microstrain"),
        ("torque_command", "mm", "N*m, V, A"),
        ("tip_deflection", "1/m", "m, mm"),
        ("time", "V", "s"),
    ],
)
def test_unit_of_another_quantity_refused(channel, unit, right):
    with pytest.raises(
        InputError,
        match=rf"'{unit}' does not measure {channel}; expected one of: {right}".replace("*", r"\*"),
    ):
        units.scale(channel, unit)


@pytest.mark.parametrize(
    ("channel", "unit", "right"),
    [
        ("hub_angle", "Rad", "rad"),
        ("torque_command", "Nm", "N*m"),
        ("torque_command", "Nmm", "N*mm"),
        ("torque_command", "mNm", "mN*m"),
        ("strain_base", "microstrian", "microstrain"),
        ("tip_acceleration", "m/s2", "m/s^2"),
        ("tip_acceleration", "g", "g_0"),
    ],
)
def test_unknown_unit_names_the_right_one(channel, unit, right):
    with pytest.raises(InputError) as caught:
        units.scale(channel, unit)
    assert f"'{unit}' is not a unit of the recording format" in str(caught.value)
    assert f"did you mean '{right}'?" in str(caught.value)


def test_unknown_unit_without_resemblance_has_no_advice():
    with pytest.raises(InputError, match=r"'smoot' is not a unit .* expected one of: rad, deg, V, A$"):
        units.scale("hub_angle", "smoot")


def test_factor_refuses_unknown_unit():
    with pytest.raises(InputError, match="'smoot' is not a unit"):
        units.factor("smoot", "m")


@pytest.mark.parametrize(
    ("channel", "unit", "expected"),
    [
        ("torque_command", "mN*m", 1e-3),
        ("torque_command", "mN·m", 1e-3),
        ("torque_command", "N m", 1.0),
        ("torque_command", "N*mm", 1e-3),
        ("torque_command", "lbf*in", 0.45359237 * 9.80665 * 0.0254),
        ("motor_torque", "kgf*cm", 0.0980665),
        ("torque_command", "mV", 1e-3),
        ("motor_torque", "mA", 1e-3),
        ("tip_deflection", "cm", 1e-2),
        ("tip_deflection", "in", 0.0254),
        ("tip_acceleration", "g_0", 9.80665),
        ("tip_acceleration", "mm/s²", 1e-3),
        ("hub_angle", "mrad", 1e-3),
        ("hub_angle", "°", math.pi / 180),
        ("hub_angle", "turn", 2 * math.pi),
        ("hub_angle", "degrees", math.pi / 180),
        ("hub_rate", "deg/s", math.pi / 180),
        ("hub_rate", "rpm", math.pi / 30),
        ("strain_base", "µε", 1e-6),
        ("strain_base", "um/m", 1e-6),
        ("strain_base", "percent", 1e-2),
        ("strain_base", "1/mm", 1.0),
        ("time", "ns", 1e-9),
        ("time", "hour", 3600.0),
    ],
)
def test_units_that_pint_knows(channel, unit, expected):
    assert units.scale(channel, unit, half_thickness=1e-3) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("channel", "unit"),
    [
        ("torque_command", "N"),
        ("torque_command", "lb*in"),
        ("hub_angle", "cm"),
        ("hub_angle", "percent"),
        ("hub_angle", "count"),
        ("hub_angle", "steradian"),
        ("strain_base", "mrad"),
        ("strain_base", "count"),
        ("strain_base", "bit"),
        ("hub_rate", "Hz"),
        ("time", "rad"),
        ("time", "m"),
    ],
)
def test_units_of_another_quantity_that_pint_knows(channel, unit):
    with pytest.raises(
        InputError, match=rf"'{unit}' does not measure {channel}; expected".replace("*", r"\*")
    ):
        units.scale(channel, unit)


@pytest.mark.parametrize(
    "unit", ["dB", "degC", "9**9**9", "2*m", "m+m", "nan", "m^9", "__import__('os')", "m" * 99]
)
def test_what_is_no_factor_is_no_unit(unit):
    assert not units.is_unit(unit)


def test_gain_of_millivolts_is_per_volt(tmp_path):
    true, gain = motion(samples=200), 2.0
    push = true | {"hub_angle": true["hub_angle"] / gain * 1e3}
    channels = CHANNELS | {"hub_angle": f'unit = "mV"\ngain = {gain}\nnoise = 0.05'}
    campaign = read_campaign(write(tmp_path, toml_text(channels, (FIT,)), push=push))
    np.testing.assert_allclose(campaign.fit[0]["hub_angle"], true["hub_angle"], atol=1e-7)
    assert campaign.sensors["hub_angle"].noise == pytest.approx(1e-4)


def test_pint_is_imported_only_when_needed():
    code = (
        "import sys; from twin.campaigns import units;"
        "units.scale('hub_angle', 'deg'); assert 'pint' not in sys.modules;"
        "units.scale('hub_angle', 'mrad'); assert 'pint' in sys.modules"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
