"""A rig with effects as MJCF: the chain with every effect for which MuJoCo has an element.

`twin.mechanics.mjcf` writes effects on the mechanics, `twin.rigs.mjcf_sensors` those on the sensors. Effects on the
drive are written as gain, bias, delay and lag of the motor (`twin.rigs.drive_law`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco

from twin.mechanics import chain, mjcf
from twin.parameters import Rig
from twin.recording import Sensor
from twin.rigs import mjcf_sensors
from twin.rigs.drive_law import DriveLaw, drive_law, nonlinear_drives
from twin.rigs.model import Effects, Model


@dataclass(frozen=True)
class AugmentedMjcf:
    """A rig in MJCF.

    Attributes:
      xml: the text of the file.
      left_out: names of mechanisms that the file lacks, as MuJoCo has no element for them.
    """

    xml: str
    left_out: tuple[str, ...]


def to_mjcf(
    rig: Rig, effects: Effects, sensors: Mapping[str, Sensor], comment: Sequence[str] = ()
) -> AugmentedMjcf:
    """Returns a rig with effects as MJCF.

    Args:
      rig: its parameters without effects.
      effects: name -> parameter -> value, SI.
      sensors: channel -> sensor; strain gauges among them are written.
      comment: lines of a comment at the head of the file, before the list of what it lacks.
    """
    model = Model(rig, sensors, chain.fit_shape(rig), effects)
    drive = drive_law(effects)
    plant = model.plant.with_motor(lag=drive.lag)
    readings = mjcf_sensors.readings(effects)
    gauges = [_with_gain(s, readings[s.channel].gain) for s in sensors.values() if s.half_thickness > 0]
    spec = mjcf.build_spec(model.rig, model.chain, plant, model.hub_torques, gauges=gauges)
    spec.modelname = _plain(rig.name)
    _write_drive(spec, drive)
    mjcf_sensors.write_sensors(spec, readings)
    left_out = (
        *mjcf.unsupported_mechanisms(plant, model.hub_torques),
        *nonlinear_drives(effects),
        *mjcf_sensors.unsupported_effects(effects),
    )
    if model.curvature_rate_rows:
        left_out += ("lag of strains behind a clamp that gives",)
    xml = f"{_comment(comment, left_out)}\n{spec.to_xml().rstrip()}\n"
    return AugmentedMjcf(xml, left_out)


def _write_drive(spec: mujoco.MjSpec, drive: DriveLaw) -> None:
    motor = spec.actuator("motor")
    # The command is limited first; gain and bias act on the limited command.
    motor.gainprm[0] = drive.gain
    motor.forcerange = drive.gain * motor.forcerange + drive.bias
    if drive.bias != 0:
        motor.biastype, motor.biasprm[0] = mujoco.mjtBias.mjBIAS_AFFINE, drive.bias
    if drive.delay > 0:
        motor.delay = drive.delay
        motor.nsample = math.ceil(drive.delay / spec.option.timestep) + 1


def _with_gain(gauge: Sensor, gain: float) -> Sensor:
    """Returns a gauge that reads `gain` times the strain."""
    return replace(gauge, half_thickness=gain * gauge.half_thickness)


def _comment(comment: Sequence[str], left_out: tuple[str, ...]) -> str:
    lines = [
        *comment,
        f"Not in this file, because MJCF cannot say it: {', '.join(left_out) or 'nothing'}.",
    ]
    return f"<!-- {chr(10).join(map(_plain, lines))} -->"


def _plain(text: str) -> str:
    """Returns a text that XML allows in a comment and in an attribute: ASCII, no mark-up, no two hyphens in a row."""
    kept = (c if c.isascii() and (c.isalnum() or c in " -_.,:'()") else "?" for c in text)
    return re.sub("-(?=-)", "- ", "".join(kept))
