"""Difference of the predictions of two fitted models on a new experiment, after both are refitted to it.

The new recording is fitted, too. So a difference that parameters can compensate within their covariance, which the old
recordings and the declared uncertainty leave, does not discriminate. To first order the predictions have the
covariance J C J', C that of the parameters, and of the difference d there remains (G. E. P. Box and W. J. Hill, 1967)

    min over a, b of |d + J2 b - J1 a|^2 / level^2 + a' C1^-1 a + b' C2^-1 b

where a, b are the changes of the parameters of the two models. Errors that cannot be predicted are added to the noise
level: the change of the prediction by a break-away torque 0.1 % off, and its nonlinear change when all other parameters
move by one standard deviation, as of a hub that sticks at another instant. Break-away torques have a derivative, but
no part in this nonlinear change: the recording itself shows where the hub sticks.

The hub angle drifts without bound under the smallest torque error; its change over a short time is compared instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.estimation.fit import Fit
from twin.estimation.unknowns import Unknown, model_at
from twin.estimation.workbench import CORRELATION_TIME, finite
from twin.mechanics.state import Start
from twin.recording import Recording
from twin.rigs.model import BREAK_AWAY_CHANGE, Model
from twin.rigs.simulate import simulate

_LARGEST_ANGLE = 2.8  # rad, to which the wires let the hub turn; assumed
_ANGLE_SPAN = 0.5  # s, over which the change of the hub angle is compared
_MOST_AXES = 4  # principal axes with a derivative; the changes by all others count as noise
_BREAK_AWAY = ("static_friction", "static_positive", "static_negative")


@dataclass(frozen=True, eq=False)
class Explanation:
    """A fitted model with the covariance of its parameters, as moves of one standard deviation.

    Attributes:
      model: at the fitted values.
      unknowns: (p) parameters of the rig and of its effects.
      values: (p) fitted numbers.
      axes: (k x p) principal axes of the covariance without break-away torques, the largest first.
      break_away: (b x p) standard deviation of each break-away torque; k + b = p.
    """

    model: Model
    unknowns: Sequence[Unknown] = ()
    values: np.ndarray = field(default_factory=lambda: np.zeros(0))
    axes: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    break_away: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @staticmethod
    def of(
        model: Model, unknowns: Sequence[Unknown], values: np.ndarray, covariance: np.ndarray
    ) -> Explanation:
        """From values (p) of the unknowns and their covariance (p x p); principal axes in units of their scales."""
        static = np.array([u.name in _BREAK_AWAY for u in unknowns], dtype=bool)
        scale = np.array([u.scale for u in unknowns])
        own = scale[~static]
        variances, vectors = np.linalg.eigh(covariance[np.ix_(~static, ~static)] / np.outer(own, own))
        axes = np.zeros((len(own), len(scale)))
        axes[:, ~static] = ((vectors * np.sqrt(np.maximum(variances, 0.0))).T * own)[::-1]
        break_away = np.diag(np.sqrt(np.diag(covariance)))[static]
        return Explanation(model, tuple(unknowns), values, axes, break_away)

    @staticmethod
    def of_fit(fitted: Fit, step: float) -> Explanation:
        """From a fit, without first states and clock; simulated with this time step [s]."""
        kept = [j for j, u in enumerate(fitted.unknowns) if u.is_parameter]
        unknowns = [fitted.unknowns[j] for j in kept]
        covariance = fitted.covariance[np.ix_(kept, kept)]
        return Explanation.of(fitted.model.replace(step=step), unknowns, fitted.values[kept], covariance)

    def moved(self, move: np.ndarray) -> Model:
        """The model with its unknowns changed by `move` (p), within their bounds."""
        low, high = np.array([u.bounds for u in self.unknowns]).T
        return model_at(self.model, self.unknowns, np.clip(self.values + move, low, high))


@dataclass(frozen=True, eq=False)
class Difference:
    """Difference of the predictions of two explanations on an experiment of m samples.

    Attributes:
      values: channel -> (m) second minus first [noise levels].
      slopes: channel -> (m x s) change of it by a move of either of one standard deviation [noise levels].
      independent: number of independent samples in one sample of a channel.
    """

    values: Mapping[str, np.ndarray]
    slopes: Mapping[str, np.ndarray]
    independent: float

    def after_refit(self, channels: Sequence[str]) -> dict[str, float]:
        """Channel -> root-mean-square difference that remains when these channels are fitted [noise levels]."""
        if not channels:
            return {}
        values = np.concatenate([self.values[c] for c in channels])
        slopes = np.concatenate([self.slopes[c] for c in channels])
        information = self.independent * slopes.T @ slopes + np.eye(slopes.shape[1])
        move = -np.linalg.solve(information, self.independent * slopes.T @ values)
        return {c: _rms(self.values[c] + self.slopes[c] @ move) for c in channels}


def difference(
    first: Explanation,
    second: Explanation,
    noise: Mapping[str, float],
    recording: Recording,
    added_mass: float = 0.0,
) -> Difference | None:
    """Difference of the predictions of an experiment by two explanations; None if the hub turns too far.

    Args:
      first, second: the explanations.
      noise: channel -> standard deviation of its noise, SI: the channels that are compared.
      recording: time [s] and torque_command [N m].
      added_mass: added payload [kg].
    """
    template = _with_channels(recording, {*noise, "hub_angle"})

    def run(model: Model) -> Recording:
        return simulate(with_added_mass(model, added_mass), template, Start())

    one, other = run(first.model), run(second.model)
    if any(np.abs(r["hub_angle"]).max() > _LARGEST_ANGLE for r in (one, other)):
        return None
    near = [
        run(first.model.with_break_away(share)) for share in (1 - BREAK_AWAY_CHANGE, 1 + BREAK_AWAY_CHANGE)
    ]
    moves = [_Moves(e, at, run) for e, at in ((first, one), (second, other))]
    values, slopes = {}, {}
    for channel, sigma in noise.items():
        change = _compared(channel, recording.time, sigma)
        by_break_away = max(_rms(change(r[channel], one[channel])) for r in near)
        level = np.linalg.norm([1.0, by_break_away, *(m.nonlinear(channel, change) for m in moves)])
        columns = [column for m in moves for column in m.slopes(channel, change)]
        values[channel] = change(other[channel], one[channel]) / level
        slopes[channel] = np.reshape(columns, (len(columns), len(recording))).T / level
    return Difference(values, slopes, recording.period / CORRELATION_TIME)


Compared = Callable[[np.ndarray, np.ndarray], np.ndarray]


class _Moves:
    """Simulations of an explanation moved along its first axes, by each break-away torque, and back along all axes."""

    def __init__(self, explanation: Explanation, at: Recording, run: Callable[[Model], Recording]):
        axes = explanation.axes
        self._at = at
        self._along = [run(explanation.moved(axis)) for axis in axes[:_MOST_AXES]]
        self._break_away = [run(explanation.moved(axis)) for axis in explanation.break_away]
        self._back = run(explanation.moved(-axes.sum(axis=0))) if len(axes) else at

    def slopes(self, channel: str, change: Compared) -> list[np.ndarray]:
        """Change (m) of a channel by a move along each of the first axes, and of each break-away torque."""
        return [change(r[channel], self._at[channel]) for r in (*self._along, *self._break_away)]

    def nonlinear(self, channel: str, change: Compared) -> float:
        """Root-mean-square change by a move back along all axes that the slopes do not predict."""
        there = sum(change(r[channel], self._at[channel]) for r in self._along)
        return _rms(change(self._back[channel], self._at[channel]) + there)


def _compared(channel: str, time: np.ndarray, sigma: float) -> Compared:
    """Function of two runs (m) of a channel: their difference in units of its noise sigma."""
    earlier = np.searchsorted(time, time - _ANGLE_SPAN)

    def change(run: np.ndarray, other: np.ndarray) -> np.ndarray:
        values = finite((run - other) / sigma)
        return (values - values[earlier]) / np.sqrt(2) if channel == "hub_angle" else values

    return change


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _with_channels(recording: Recording, channels: Iterable[str]) -> Recording:
    """The recording with these channels, all zero, as a template of what a simulation returns."""
    blank = np.zeros(len(recording))
    return recording.replace(channels={**recording.channels, **{c: blank for c in channels}})


def with_added_mass(model: Model, added_mass: float) -> Model:
    """The model with more payload [kg], also where an effect replaces the declared payload."""
    if added_mass == 0:
        return model
    declared = model.declared.replace(tip_mass=model.declared["tip_mass"] + added_mass)
    effects = {
        name: {p: v + added_mass if p == "tip_mass" else v for p, v in values.items()}
        for name, values in model.effects.items()
    }
    return model.replace(declared=declared, effects=effects)
