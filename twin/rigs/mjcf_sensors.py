"""Effects on the sensors in MJCF, as tendons, actuators and sensor delays.

A reading that is a multiple of the true value is the length of a fixed tendon. Any other is the sum of the forces of
actuators on such a tendon, with a gear ratio so small that they do not affect the motion:

    truth       an actuator whose bias is the tendon's length
    offset      an actuator whose bias is constant
    drift       an integrator of a command that is limited to 1: its activation is the time
    wave        the cogging of MuJoCo's motor, a sinusoid of the tendon's length
    delay       the sensor's delay, with interpolation between the samples of its history; it reads 0 until then
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
"""Channel -> name of the sensor of `mjcf.build_spec` that measures it."""

_MUJOCO = int(mujoco.__version__.partition(".")[0])  # major version
_GEAR = 1e-9  # [1] gear ratio of actuators that only measure: 1 rad of the hub makes a torque of 1e-9 N m
_CUBIC = 2  # value of a sensor's `interp`: cubic interpolation of its history


Readings = Mapping[str, Reading]
"""Channel -> its reading as a function of the true value."""


def readings(effects: Effects) -> Readings:
    """Returns the reading of every channel under effects, applied in their order."""
    return {channel: _reading(channel, effects) for channel in SENSORS}


def _reading(channel: str, effects: Effects) -> Reading:
    reading = Reading()
    for name, p in effects.items():
        reading = REGISTRY[name].reading(reading, channel, p) or reading
    return reading


def unsupported_effects(effects: Effects) -> tuple[str, ...]:
    """Returns the names of the effects whose readings MJCF has no element for."""
    return tuple(
        name
        for name, p in effects.items()
        if any(REGISTRY[name].reading(Reading(), channel, p) is None for channel in SENSORS)
    )


def write_sensors(spec: mujoco.MjSpec, channels: Readings) -> None:
    """Changes the sensors of a specification such that they report the given readings.

    Args:
      spec: from `mjcf.build_spec`, with the gains of the strain gauges included in the gauges.
      channels: channel -> reading.
    """
    for channel, reading in channels.items():
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
    """Makes the sensor read the length of a tendon of its name, gain times a joint's angle."""
    spec.add_tendon(name=sensor.name, group=5).wrap_joint(joint, gain)
    sensor.type, sensor.objtype = mujoco.mjtSensor.mjSENS_TENDONPOS, mujoco.mjtObj.mjOBJ_TENDON
    sensor.objname = sensor.name


def _read_sum(spec: mujoco.MjSpec, sensor: mujoco.MjsSensor, reading: Reading) -> None:
    """Makes the sensor read the force on its tendon: the sum of its length, a drift and a sinusoid."""
    sensor.type = mujoco.mjtSensor.mjSENS_TENDONACTFRC
    truth = _tendon_actuator(spec, sensor, "truth")
    truth.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    truth.gainprm[0], truth.biasprm[1] = 0.0, 1 / _GEAR
    if reading.offset != 0:
        # An actuator of its own: MuJoCo 4 writes a small number beside a large one as 0.
        offset = _tendon_actuator(spec, sensor, "offset")
        offset.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        offset.gainprm[0], offset.biasprm[0] = 0.0, reading.offset
    if reading.rate != 0:
        drift = _tendon_actuator(spec, sensor, "drift")
        drift.dyntype, drift.gainprm[0] = mujoco.mjtDyn.mjDYN_INTEGRATOR, reading.rate
        drift.ctrllimited, drift.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, [1.0, 1.00001]
    if reading.amplitude != 0:
        wave = _tendon_actuator(spec, sensor, "wave")
        mjcf.set_sinusoid(wave, reading.amplitude, reading.order / _GEAR, reading.phase)


def _tendon_actuator(spec: mujoco.MjSpec, sensor: mujoco.MjsSensor, what: str) -> mujoco.MjsActuator:
    """Returns a new actuator on the tendon of a sensor, with the gear ratio `_GEAR`."""
    kind = mujoco.mjtTrn.mjTRN_TENDON
    actuator = spec.add_actuator(name=f"{sensor.name}_{what}", target=sensor.name, trntype=kind)
    actuator.gear[0] = _GEAR
    return actuator


def _delay(spec: mujoco.MjSpec, sensor: mujoco.MjsSensor, delay: float) -> None:
    """Delays a sensor by `delay` [s]: interpolated between the samples of its history, or held for a torque.

    MuJoCo 3 stores a sample after the last stage of RK4 and stamps it with the start of the step. Tendons and frames
    are then evaluated at the end of the step, which costs one step; joints are at its start, and a torque is constant.
    MuJoCo 4 stores it at the start.
    """
    kind, held = mujoco.mjtSensor, sensor.type == mujoco.mjtSensor.mjSENS_ACTUATORFRC
    step = spec.option.timestep
    at_start = held or sensor.type == kind.mjSENS_JOINTPOS or _MUJOCO >= 4
    sensor.delay = delay if at_start else delay + step
    # Cubic interpolation needs one more sample at each end.
    sensor.nsample = math.ceil(sensor.delay / step) + 3
    sensor.interp = 0 if held else _CUBIC
