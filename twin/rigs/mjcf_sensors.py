"""What sensors report, in MJCF: effects of the sensors become tendons, actuators and delays.

A reading that is a multiple of the truth is the length of a fixed tendon. One with more to it is the force on such a
tendon, which MuJoCo adds up over the actuators that pull at it, at a gear so small that no motion feels them:

    truth       an actuator whose bias is the tendon's length
    drift       an integrator of a command that cannot leave 1: its activation is the time
    wave        the cogging of MuJoCo's motor
    delay       of the sensor, with a history between whose samples it interpolates; until it has passed, 0 is read
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import mujoco

from twin.effects import REGISTRY
from twin.effects.reading import Reading
from twin.mechanics import mjcf
from twin.rigs.model import Effects

SENSORS = {
    "hub_angle": "hub_angle",
    "strain_base": "strain_base",
    "strain_mid": "strain_mid",
    "tip_deflection": "tip_from_hub",
    "tip_acceleration": "tip_acceleration",
    "motor_torque": "motor_torque",
}
"""Channel -> the sensor of `mjcf.build_spec` that reads it."""

_GEAR = 1e-9  # of actuators that only read: 1 rad on the hub is a torque of 1e-9 N m
_CUBIC = 2  # `interp` of a history


Readings = Mapping[str, Reading]
"""Channel -> what is reported of it."""


def readings(effects: Effects) -> Readings:
    """Returns what effects, in their order, make of the true value of every channel."""
    return {channel: _reading(channel, effects) for channel in SENSORS}


def _reading(channel: str, effects: Effects) -> Reading:
    reading = Reading()
    for name, p in effects.items():
        reading = REGISTRY[name].reading(reading, channel, p) or reading
    return reading


def unsupported_effects(effects: Effects) -> tuple[str, ...]:
    """Names of the effects whose readings MJCF cannot say."""
    return tuple(
        name
        for name, p in effects.items()
        if any(REGISTRY[name].reading(Reading(), channel, p) is None for channel in SENSORS)
    )


def write_sensors(spec: mujoco.MjSpec, found: Readings) -> None:
    """Makes the sensors of a rig report as they do.

    Args:
      spec: from `mjcf.build_spec`, with the gains of the gauges in them.
      found: channel -> reading.
    """
    for channel, reading in found.items():
        sensor = spec.sensor(SENSORS[channel])
        if sensor is None:
            continue
        if channel == "hub_angle" and replace(reading, delay=0.0) != Reading():
            _read_through_tendon(spec, sensor, "hub", reading.gain)
        if reading.twist != 0:
            spec.tendon(channel).wrap_joint("torsion", reading.twist)
        if reading.is_sum:
            _read_sum(spec, sensor, reading)
        if reading.delay > 0:
            _delay(spec, sensor, reading.delay)


# Elements


def _read_through_tendon(spec: mujoco.MjSpec, sensor: mujoco.MjsSensor, joint: str, gain: float) -> None:
    """The sensor reads the length of a tendon of its name, gain times a joint's angle."""
    spec.add_tendon(name=sensor.name, group=5).wrap_joint(joint, gain)
    sensor.type, sensor.objtype = mujoco.mjtSensor.mjSENS_TENDONPOS, mujoco.mjtObj.mjOBJ_TENDON
    sensor.objname = sensor.name


def _read_sum(spec: mujoco.MjSpec, sensor: mujoco.MjsSensor, reading: Reading) -> None:
    """The sensor adds up what pulls at its tendon: its length, a drift, a wave."""
    sensor.type = mujoco.mjtSensor.mjSENS_TENDONACTFRC
    truth = _tendon_actuator(spec, sensor, "truth")
    truth.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    truth.gainprm[0], truth.biasprm[0], truth.biasprm[1] = 0.0, reading.offset, 1 / _GEAR
    if reading.rate != 0:
        drift = _tendon_actuator(spec, sensor, "drift")
        drift.dyntype, drift.gainprm[0] = mujoco.mjtDyn.mjDYN_INTEGRATOR, reading.rate
        drift.ctrllimited, drift.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, [1.0, 1.00001]
    if reading.amplitude != 0:
        wave = _tendon_actuator(spec, sensor, "wave")
        mjcf.set_sinusoid(wave, reading.amplitude, reading.order / _GEAR, reading.phase)


def _tendon_actuator(spec: mujoco.MjSpec, sensor: mujoco.MjsSensor, what: str) -> mujoco.MjsActuator:
    kind = mujoco.mjtTrn.mjTRN_TENDON
    puller = spec.add_actuator(name=f"{sensor.name}_{what}", target=sensor.name, trntype=kind)
    puller.gear[0] = _GEAR
    return puller


def _delay(spec: mujoco.MjSpec, sensor: mujoco.MjsSensor, delay: float) -> None:
    """The sensor reads what its history says of `delay` [s] ago: between samples, or held as a torque is.

    A history is written when RK4 has just been at the end of the step: there it finds tendons and frames, and
    stamps them with the start. Joints are back at the start, and a torque is the same all along.
    """
    kind, held = mujoco.mjtSensor, sensor.type == mujoco.mjtSensor.mjSENS_ACTUATORFRC
    step = spec.option.timestep
    sensor.delay = delay if held or sensor.type == kind.mjSENS_JOINTPOS else delay + step
    sensor.nsample = math.ceil(sensor.delay / step) + 3  # a cubic needs one more at each end
    sensor.interp = 0 if held else _CUBIC
