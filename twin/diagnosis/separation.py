"""How far two explanations are apart on an experiment once both have given way to it, in noise levels.

Whoever records it fits again: what parameters can do within the errors that the old recordings and the declaration
leave them tells nothing apart. To first order an explanation predicts the channels y with the covariance J C J', C of
its parameters, and what counts of the difference d is what the moves a, b of the two leave of it (G. E. P. Box and
W. J. Hill, 1967):

    min over a, b of |d + J2 b - J1 a|^2 / level^2 + a' C1^-1 a + b' C2^-1 b

What cannot be predicted counts as noise in the level: what a break-away torque 0.1 % off changes, and what a move of
all other parameters does beyond the slopes, such as a hub that sticks between two swings or does not. Break-away
torques have a slope but no part in that move: the recording itself shows where the hub sticks.
Of the hub angle, which drifts without end under the smallest torque, the change over a short time counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.estimation.fit import Fit
from twin.estimation.unknowns import Unknown, model_at
from twin.estimation.workbench import CORRELATION_TIME
from twin.mechanics.state import Start
from twin.recording import Recording
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

_NEARBY = 1e-3  # relative change of the break-away torque
_TURN = 2.8  # rad, how far a hub with wires may turn; assumed
_MEMORY = 0.5  # s, over which the change of the hub angle is compared
_SLOPES = 4  # axes of an explanation that have one; what the others do counts as noise
_BREAK_AWAY = ("static_friction", "static_positive", "static_negative")
_RUNAWAY = 1e6  # noise levels, of a simulation that ran away


@dataclass(frozen=True, eq=False)
class Explanation:
    """A fitted model, and how far its parameters may yet move, each by one standard deviation.

    Attributes:
      model: at the fitted values.
      unknowns: parameters of the rig and of its effects (p).
      values: (p) as a fit moves them.
      axes: (k x p) principal axes of the covariance, break-away torques apart, the least known first.
      break_away: (b x p) moves of the break-away torques, each alone; k + b = p.
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
        """That of unknowns at values (p) with a covariance (p x p), whose axes are in units of the unknowns' scales."""
        sticks = np.array([u.name in _BREAK_AWAY for u in unknowns], dtype=bool)
        scale = np.array([u.scale for u in unknowns])
        own = scale[~sticks]
        variances, vectors = np.linalg.eigh(covariance[np.ix_(~sticks, ~sticks)] / np.outer(own, own))
        axes = np.zeros((len(own), len(scale)))
        axes[:, ~sticks] = ((vectors * np.sqrt(np.maximum(variances, 0.0))).T * own)[::-1]
        break_away = np.diag(np.sqrt(np.diag(covariance)))[sticks]
        return Explanation(model, tuple(unknowns), values, axes, break_away)

    @staticmethod
    def of_fit(fitted: Fit, step: float) -> Explanation:
        """That of a fit, to be simulated with a step [s]; states at first samples and the card's clock are left out."""
        kept = [j for j, u in enumerate(fitted.unknowns) if u.is_parameter]
        unknowns = [fitted.unknowns[j] for j in kept]
        covariance = fitted.covariance[np.ix_(kept, kept)]
        return Explanation.of(fitted.model.replace(step=step), unknowns, fitted.values[kept], covariance)

    def moved(self, move: np.ndarray) -> Model:
        """The model with its unknowns moved (p), as far as their bounds let them."""
        low, high = np.array([u.bounds for u in self.unknowns]).T
        return model_at(self.model, self.unknowns, np.clip(self.values + move, low, high))


@dataclass(frozen=True, eq=False)
class Difference:
    """What two explanations predict differently on an experiment; m samples.

    Attributes:
      apart: channel -> (m) second minus first [noise levels].
      slopes: channel -> (m x s) what moves of either by one standard deviation change in it [noise levels].
      evidence: independent pieces of evidence in a sample of a channel.
    """

    apart: Mapping[str, np.ndarray]
    slopes: Mapping[str, np.ndarray]
    evidence: float

    def left(self, channels: Sequence[str]) -> dict[str, float]:
        """Channel -> RMS difference [noise levels] that is left if these channels are recorded and fitted."""
        if not channels:
            return {}
        apart = np.concatenate([self.apart[c] for c in channels])
        slopes = np.concatenate([self.slopes[c] for c in channels])
        information = self.evidence * slopes.T @ slopes + np.eye(slopes.shape[1])
        move = -np.linalg.solve(information, self.evidence * slopes.T @ apart)
        return {c: _rms(self.apart[c] + self.slopes[c] @ move) for c in channels}


def difference(
    first: Explanation,
    second: Explanation,
    noise: Mapping[str, float],
    recording: Recording,
    added_mass: float = 0.0,
) -> Difference | None:
    """Simulates an experiment under two explanations; None if the hub turns too far.

    Args:
      noise: channel -> standard deviation of its noise, SI: the channels that are compared.
      recording: time [s] and torque_command [N m].
      added_mass: payload added [kg].
    """
    asked = _with_channels(recording, {*noise, "hub_angle"})

    def run(model: Model) -> Recording:
        return simulate(loaded(model, added_mass), asked, Start())

    one, other = run(first.model), run(second.model)
    if any(np.abs(r["hub_angle"]).max() > _TURN for r in (one, other)):
        return None
    near = [run(first.model.with_break_away(share)) for share in (1 - _NEARBY, 1 + _NEARBY)]
    moves = [_Moves(e, at, run) for e, at in ((first, one), (second, other))]
    apart, slopes = {}, {}
    for channel, sigma in noise.items():
        change = _compared(channel, recording.time, sigma)
        by_break_away = max(_rms(change(r[channel], one[channel])) for r in near)
        level = np.linalg.norm([1.0, by_break_away, *(m.beyond(channel, change) for m in moves)])
        columns = [column for m in moves for column in m.slopes(channel, change)]
        apart[channel] = change(other[channel], one[channel]) / level
        slopes[channel] = np.reshape(columns, (len(columns), len(recording))).T / level
    return Difference(apart, slopes, recording.period / CORRELATION_TIME)


Compared = Callable[[np.ndarray, np.ndarray], np.ndarray]


class _Moves:
    """Runs of an explanation moved: along some axes, by each break-away torque, and along all axes the other way."""

    def __init__(self, explanation: Explanation, at: Recording, run: Callable[[Model], Recording]):
        axes = explanation.axes
        self._at = at
        self._along = [run(explanation.moved(axis)) for axis in axes[:_SLOPES]]
        self._break_away = [run(explanation.moved(axis)) for axis in explanation.break_away]
        self._back = run(explanation.moved(-axes.sum(axis=0))) if len(axes) else at

    def slopes(self, channel: str, change: Compared) -> list[np.ndarray]:
        """Change (m) of a channel along each axis, and with each break-away torque."""
        return [change(r[channel], self._at[channel]) for r in (*self._along, *self._break_away)]

    def beyond(self, channel: str, change: Compared) -> float:
        """RMS of what the move along all axes does beyond the slopes."""
        there = sum(change(r[channel], self._at[channel]) for r in self._along)
        return _rms(change(self._back[channel], self._at[channel]) + there)


def _compared(channel: str, time: np.ndarray, sigma: float) -> Compared:
    """Difference (m) of two runs in a channel whose noise is sigma, in that noise."""
    earlier = np.searchsorted(time, time - _MEMORY)

    def change(run: np.ndarray, other: np.ndarray) -> np.ndarray:
        values = np.clip(np.nan_to_num((run - other) / sigma, nan=_RUNAWAY), -_RUNAWAY, _RUNAWAY)
        return (values - values[earlier]) / np.sqrt(2) if channel == "hub_angle" else values

    return change


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _with_channels(recording: Recording, channels: Iterable[str]) -> Recording:
    """The recording with empty channels: a simulation fills those that it is asked for."""
    blank = np.zeros(len(recording))
    return recording.replace(channels={**recording.channels, **{c: blank for c in channels}})


def loaded(model: Model, added_mass: float) -> Model:
    """The model with more payload, whatever effect moved the payload before."""
    if added_mass == 0:
        return model
    declared = model.declared.replace(tip_mass=model.declared["tip_mass"] + added_mass)
    effects = {
        name: {p: v + added_mass if p == "tip_mass" else v for p, v in values.items()}
        for name, values in model.effects.items()
    }
    return model.replace(declared=declared, effects=effects)
