"""The paper's experiments by name: Bossi et al. 2009, section VI; what the paper does not specify is assumed.

Assumed: a bang-bang torque is +-0.2 N m, just below saturation, with halves of equal length, chosen such that the rigid
rig without friction turns by the designed angle; a step is filtered by 1/(0.5 s + 1)^2; the sample period is 2 ms; a
run lasts 5 s, or 20 s for a sinusoid, whose figures are of the second half.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.control.closed_loop import Run
from twin.control.laws.base import Controller
from twin.control.laws.library import controller as named_controller
from twin.control.plants.base import Reference
from twin.errors import InputError, nearest
from twin.mechanics.beam import rigid_inertia

BANG_BANG_TORQUE = 0.2
"""Largest amplitude of the bang-bang profiles [N m], assumed."""

FILTER_TIME = 0.5
"""Time constant of both poles of the step's filter [s], assumed."""

SINUS_AMPLITUDE = math.radians(40.0)
"""Amplitude of the sinusoidal references [rad], section VI."""
_DURATION, _SINUS_DURATION = 5.0, 20.0  # s, assumed


@dataclass(frozen=True)
class Scenario:
    """One experiment.

    Attributes:
      name: on the command line.
      reference: reference of the hub angle [rad] as a function of time [s].
      duration: [s].
      controller: name of its controller, or "bang-bang".
      angle: rotation for which it is designed [rad].
      from_half: whether its figures are of the second half of a run only.
    """

    name: str
    reference: Reference
    duration: float
    controller: str
    angle: float
    from_half: bool = False

    def own_controller(self, rig: Mapping[str, float], period: float) -> Controller:
        """Returns the scenario's controller for a rig and a sample period [s]."""
        if self.controller == "bang-bang":
            return bang_bang(rig, self.angle, period)
        return named_controller(self.controller, rig, period)


class BangBang:
    """An open-loop torque: +u until the switch, -u for an equal time, then 0."""

    def __init__(self, torque: float, switch: float) -> None:
        """Takes the amplitude [N m] and the instant of the switch [s]."""
        self._torque, self._switch = torque, switch

    def reset(self) -> None:
        """Does nothing: the torque depends on time alone."""

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque [N m]; see `Controller`."""
        now = measured["time"] + _INSTANT
        if now < self._switch:
            return self._torque
        return -self._torque if now < 2 * self._switch else 0.0


_INSTANT = 1e-9  # s, tolerance for rounding of sample instants


def bang_bang(
    rig: Mapping[str, float], angle: float, period: float, largest: float = BANG_BANG_TORQUE
) -> BangBang:
    """Designs a bang-bang torque that turns the rigid rig without friction by `angle` [rad]: angle = u T^2/J.

    The switch falls on a sample, for which the amplitude is slightly less than the `largest` [N m], or than the limit
    of the amplifier where that is less.
    """
    inertia, largest = rigid_inertia(rig), min(largest, rig.get("torque_limit", math.inf))
    samples = math.ceil(math.sqrt(angle * inertia / largest) / period)
    switch = samples * period
    return BangBang(angle * inertia / switch**2, switch)


def filtered_step(angle: float, time_constant: float = FILTER_TIME) -> Reference:
    """Returns the response of 1/(T s + 1)^2 to a step of `angle` [rad], T being `time_constant` [s]."""

    def reference(time: float) -> float:
        x = time / time_constant
        return angle * (1 - (1 + x) * math.exp(-x))

    return reference


def _sinus(frequency: float) -> Scenario:
    def reference(time: float) -> float:
        return SINUS_AMPLITUDE * math.sin(2 * math.pi * frequency * time)

    return Scenario(f"sinus-{frequency}", reference, _SINUS_DURATION, "siso", SINUS_AMPLITUDE, from_half=True)


def _bang_bang(degrees: int) -> Scenario:
    angle = math.radians(degrees)
    return Scenario(f"bang-bang-{degrees}", lambda time: angle, _DURATION, "bang-bang", angle)


_TURN = math.radians(120.0)  # rad, section VI
SCENARIOS: Mapping[str, Scenario] = {
    s.name: s
    for s in (
        *(_bang_bang(degrees) for degrees in (20, 45, 60, 90, 120)),
        _sinus(0.2),
        _sinus(0.4),
        Scenario("filtered-step-120", filtered_step(_TURN), _DURATION, "siso", _TURN),
        Scenario("lq-step-120", lambda time: _TURN, _DURATION, "lqi", _TURN),
    )
}


def scenario(name: str) -> Scenario:
    """Returns the scenario called `name`.

    Raises:
      InputError: there is none.
    """
    if name not in SCENARIOS:
        raise InputError(
            f"'{name}' is not a scenario; expected one of: {', '.join(SCENARIOS)}{nearest(name, SCENARIOS)}"
        )
    return SCENARIOS[name]


def metrics(run: Run, from_half: bool = False) -> dict[str, float]:
    """Returns figures of a run: hub angles relative to the start [deg], deflection [mm], torque [N m], time shares [1].

    Args:
      run: the run.
      from_half: of its second half only; the final angle is always that of the end.
    """
    kept = slice(len(run.time) // 2 if from_half else 0, None)
    turned = np.degrees(run.true["hub_angle"] - run.true["hub_angle"][0])
    torque = np.abs(run.true["motor_torque"])[kept]
    return {
        "hub_final_deg": float(turned[-1]),
        "hub_min_deg": float(turned[kept].min()),
        "hub_max_deg": float(turned[kept].max()),
        "peak_deflection_mm": float(1e3 * np.abs(run.true["tip_deflection"][kept]).max()),
        "peak_torque_nm": float(torque.max()),
        "saturated_fraction": float(
            np.mean(np.abs(run.torque_command[kept]) >= run.torque_limit * (1 - 1e-9))
        ),
        "stuck_fraction": float(np.mean(run.modes[kept] == 0)),
    }
