"""A rig with effects as a linear state space about rest at a hub angle, for MATLAB and python-control."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.control.plants import linear_chain
from twin.control.plants.base import READINGS
from twin.recording import CHANNEL_UNITS
from twin.rigs.drive_law import drive_law
from twin.rigs.model import Model

if TYPE_CHECKING:
    import control

_LATER = (0.37, 1.9)  # s, without integer ratio, so that no period hides


@dataclass(frozen=True)
class LinearModel:
    """x_t = A x + B (u(t - input_delay) - u0), y(t + output_delay) = y0 + C x + D (u(t - input_delay) - u0).

    u is the commanded torque [N m], y are the readings in the order of `READINGS`, SI.

    Attributes:
      name: of the rig.
      hub_angle: about which [rad].
      A, B, C, D: (k, k), (k, 1), (5, k), (5, 1).
      states, state_units: (k) names and units.
      command: u0, which holds the rig at rest without dry friction [N m].
      readings: y0 (5), SI.
      input_delay: [s].
      output_delays: (5) [s].
      left_out: what is not in the model, in words.
    """

    name: str
    hub_angle: float
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[str, ...]
    state_units: tuple[str, ...]
    command: float
    readings: np.ndarray
    input_delay: float
    output_delays: np.ndarray
    left_out: tuple[str, ...]

    inputs = ("torque_command",)
    input_units = ("N*m",)
    outputs = READINGS
    output_units = tuple(CHANNEL_UNITS[name] for name in READINGS)

    @property
    def title(self) -> str:
        """What it is, in a line."""
        return (
            f"{self.name} linearised about rest at a hub angle of {math.degrees(self.hub_angle):.4g} degrees"
        )

    def to_control(self) -> control.StateSpace:
        """Returns the state space for python-control, which has no delays."""
        import control  # the import takes a second: only where it is needed

        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs)}
        return control.ss(self.A, self.B, self.C, self.D, name="rig", **names)


def linear_model(model: Model, hub_angle: float = 0.0) -> LinearModel:
    """Returns the linear model of a rig with effects about rest at a hub angle [rad]."""
    gone = [name for name, p in model.effects.items() if not linear_chain.can_be_linearised(name, p)]
    kept = model.replace(effects={name: p for name, p in model.effects.items() if name not in gone})
    chain = linear_chain.linearised_at(kept, hub_angle)
    gain, delay, lag = linear_chain.drive_model(kept)
    A, B, C, D = _with_drive(*chain.first_order(), gain, lag)
    holding = linear_chain.holding_torque(kept, hub_angle)
    true = _true_values(kept, hub_angle, holding)
    slopes, delays = linear_chain.sensor_model(kept, true)
    names, units = _states(len(chain.mass), lag > 0)
    return LinearModel(
        model.declared.name,
        hub_angle,
        A,
        B,
        slopes @ C,
        slopes @ D,
        names,
        units,
        (holding - drive_law(kept.effects).bias) / gain,
        _readings(kept, true),
        delay,
        delays,
        ("dry friction of the hub", "limit of the command", *gone, *_moving_with_time(kept, hub_angle)),
    )


def _moving_with_time(model: Model, hub_angle: float) -> tuple[str, ...]:
    """What acts from outside as a function of time; the model has its value at time 0."""
    torques = [
        t.name
        for t in model.hub_torques
        if any(t.at(s, hub_angle, 0.0) != t.at(0.0, hub_angle, 0.0) for s in _LATER)
    ]
    return (*torques, *(["acceleration of the base"] if model.plant.link.is_shaken else []))


def _with_drive(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, gain: float, lag: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Adds gain [1] and lag [s] of the drive, and the delivered torque as the last true value."""
    n, count = len(A), len(C)
    if lag <= 0:
        return A, gain * B, np.vstack([C, np.zeros(n)]), np.r_[np.zeros(count), gain][:, None]
    A = np.block([[A, B], [np.zeros((1, n)), np.full((1, 1), -1 / lag)]])
    C = np.block([[C, np.zeros((count, 1))], [np.zeros((1, n)), np.ones((1, 1))]])
    return A, np.r_[np.zeros(n), gain / lag][:, None], C, np.zeros((count + 1, 1))


def _states(n: int, lagging: bool) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the states of n coordinates, and of the delivered torque of a drive with a lag."""
    names = (*(f"angle_{k}" for k in range(n)), *(f"rate_{k}" for k in range(n)))
    units = ("rad",) * n + ("rad/s",) * n
    return ((*names, "torque"), (*units, "N*m")) if lagging else (names, units)


def _true_values(model: Model, hub_angle: float, torque: float) -> dict[str, float]:
    """What the sensors measure at rest at a hub angle [rad] under a delivered torque [N m], SI."""
    angles = linear_chain.equilibrium(model, hub_angle)
    bends = np.diff(angles[: len(model.chain.lengths)])
    deflection = model.plant.link.lengths @ np.sin(angles - angles[0])
    strains = {name: float(row @ bends) for name, row in model.strain_rows.items()}
    return {"hub_angle": hub_angle, "tip_deflection": float(deflection), **strains, "motor_torque": torque}


def _readings(model: Model, true: dict[str, float]) -> np.ndarray:
    """Readings (5) of true values at the first sample, SI."""
    held = {name: np.full(2, true.get(name, 0.0)) for name in linear_chain.TRUE_VALUES}
    reported = model.report(np.array([0.0, 1e-3]), held)
    return np.array([float(reported[name][0]) for name in READINGS])
