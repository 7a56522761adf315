"""Sensors of a bench: a potentiometer on the hub, and a gauge in volts or a tip sensor in millimetres."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.virtual_rig.beam import Array, Link, curvature_at
from twin.virtual_rig.bench.kinds import log_uniform
from twin.virtual_rig.plant import hub_angle, quantised, sensed_hub
from twin.virtual_rig.rig import Rig

LinkChannel = Literal["strain_base", "tip_deflection"]

GAUGE_POSITION = 0.02  # m from the hub axis
_GAUGE_STEP = 20.0 / 2**12  # V, of a converter of 12 bits over +-10 V
_LOOP_RATES = {250: 0.2, 500: 0.5, 1000: 0.3}
"""Sample rates of a controller [Hz], with their shares."""
_LOGGER_RATES = {50: 0.05, 100: 0.05, 250: 0.25, 500: 0.45, 1000: 0.2}
"""The same of a data logger without a controller."""
_SOFT = 0.15  # N m^2: a stiffer ruler bends too little for a tip sensor


@dataclass(frozen=True)
class BenchSensors:
    """Sampling, and standard deviations of white noise, steps of the converter, gain and zero of the sensors."""

    sample_rate: float  # Hz
    hub_noise: float  # rad
    hub_step: float  # rad
    link_channel: LinkChannel
    link_gain: float  # 1/m per V, or m per mm
    link_noise: float  # V or mm, as all below
    link_step: float
    link_zero: float  # reading of the unbent link, not declared

    def noise_levels(self) -> dict[str, float]:
        """Returns the standard deviations of noise and quantisation by channel, SI."""
        return {
            "hub_angle": _level(self.hub_noise, self.hub_step),
            self.link_channel: self.link_gain * _level(self.link_noise, self.link_step),
        }


def drawn_sensors(rig: Rig, closed: bool, generator: np.random.Generator) -> BenchSensors:
    """Returns random sensors; a controller samples at 250 Hz at least, a simple data logger sometimes slower."""
    rates = _LOOP_RATES if closed else _LOGGER_RATES
    on_tip = rig.bending_stiffness < _SOFT and generator.random() < 0.6
    step = float(generator.choice([0.5, 1.0])) if on_tip else _GAUGE_STEP
    noise = step * generator.uniform(0.4, 1.0)
    zero = generator.choice([-1, 1]) * generator.uniform(5.0, 20.0) * _level(noise, step)
    return BenchSensors(
        sample_rate=float(generator.choice(list(rates), p=list(rates.values()))),
        hub_noise=generator.uniform(3e-4, 1e-3),
        hub_step=generator.uniform(6e-4, 1.6e-3),
        link_channel="tip_deflection" if on_tip else "strain_base",
        link_gain=1e-3 if on_tip else log_uniform(0.4, 1.2, generator),
        link_noise=noise,
        link_step=step,
        link_zero=float(zero),
    )


def true_readings(rig: Rig, link: Link, sensors: BenchSensors, states: Array) -> dict[str, Array]:
    """Returns the readings of states (samples x 2 nz) without noise and zeros (samples,), SI; gauges read curvature."""
    n = len(link.stiffness)
    if sensors.link_channel == "tip_deflection":
        bend = np.sin(states[:, :n] @ link.slope[:-1, :n].T) @ link.to_tip
    else:
        bend = states[:, :n] @ curvature_at(rig, np.array([GAUGE_POSITION]), n)[0]
    return {"hub_angle": sensed_hub(rig, hub_angle(rig, link, states)), sensors.link_channel: bend}


def raw_readings(
    sensors: BenchSensors, true: dict[str, Array], hub_noise: Array, generator: np.random.Generator
) -> dict[str, Array]:
    """Returns the columns of the sensors in a file (samples,), in their own units."""
    volts = true[sensors.link_channel] / sensors.link_gain + sensors.link_zero
    noise = sensors.link_noise * generator.standard_normal(len(volts))
    return {
        "pot": quantised(true["hub_angle"] + hub_noise, sensors.hub_step),
        "link": quantised(volts + noise, sensors.link_step),
    }


def _level(noise: float, step: float) -> float:
    """Returns the standard deviation of noise and quantisation together."""
    return math.hypot(noise, step / math.sqrt(12))
