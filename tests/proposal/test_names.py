"""What names of columns say: channels in the words of several laboratories, and units."""

import pytest

from twin.campaigns.units import TIME
from twin.proposal import names
from twin.proposal.assign import by_name


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        (
            ["motor_voltage", "hub_angle", "pot_volts", "strain_volts"],
            {"torque_command": "motor_voltage", "hub_angle": "hub_angle", "strain_base": "strain_volts"},
        ),
        (
            ["current_command", "current", "hub_reference", "hub_angle", "stage2_current", "stage2_angle"],
            {
                "torque_command": "current_command",
                "motor_torque": "current",
                "hub_reference": "hub_reference",
                "hub_angle": "hub_angle",
            },
        ),
        (
            ["goal_position", "position", "speed", "load", "temperature", "torque_enable"],
            {"hub_reference": "goal_position", "hub_angle": "position", "hub_rate": "speed"},
        ),
        (
            ["out.Tau [N*m]", "out.Theta (deg)", "out.Gauge1", "out.Gauge2"],
            {
                "torque_command": "out.Tau [N*m]",
                "hub_angle": "out.Theta (deg)",
                "strain_base": "out.Gauge1",
                "strain_mid": "out.Gauge2",
            },
        ),
        (
            ["MotorVoltage", "motorEncoder", "tipAcceleration", "tip_deflection_mm", "setpoint"],
            {
                "torque_command": "MotorVoltage",
                "motor_angle": "motorEncoder",
                "tip_acceleration": "tipAcceleration",
                "tip_deflection": "tip_deflection_mm",
                "hub_reference": "setpoint",
            },
        ),
        (["c0", "c1", "x", "Channel 3"], {}),
    ],
)
def test_channels_by_name(columns, expected):
    assert {found.channel: found.column for found in by_name(columns)} == expected


@pytest.mark.parametrize("name", ["time", "t", "Time [s]", "timestamp", "rec.time"])
def test_a_time_is_known_by_its_name(name):
    assert TIME in names.fits(name)


@pytest.mark.parametrize(
    ("name", "told", "unit"),
    [
        ("angle", "deg", "deg"),
        ("angle [deg]", "", "deg"),
        ("torque (Nm)", "", "N*m"),
        ("tau [mN·m]", "", "mN·m"),
        ("tip_mm", "", "mm"),
        ("strain_volts", "", "V"),
        ("angle", "", ""),
        ("x [nonsense]", "", ""),
    ],
)
def test_units_of_columns(name, told, unit):
    assert names.unit_of(name, told) == unit
