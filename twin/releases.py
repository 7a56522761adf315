"""Static friction levels by runs that begin in a measured rest: the level at which they leave it as the rig did.

Where a torque grows slowly, the instant of a break-away tells its level; a hub that has just come free gains speed so
quickly that a few readings behind it tell that instant better than a sample period. Nothing else that sticks or slips
enters: what the link does until then follows from the measured hub, and the run ends before that comes to rest again.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin import driven, planar
from twin.driven import DrivenData
from twin.fit import Prepared
from twin.model import Model, Motion, Start, delivered, reported
from twin.observe import BEFORE_ONSET
from twin.planar import STUCK
from twin.recording import Recording

_REST = 0.2  # s before a break-away in which the hub has to rest
_BEFORE, _BEHIND = 0.06, 0.06  # s about a break-away that are run, from beyond the reach of the filter
_FEWEST = 8  # readings behind the break-away that tell its instant
_LATE, _OFF = 0.02, 0.005  # s by which the instant, and part by which the torque, may have been misread
_INSTANT = 5e-4  # s to which a model tells when it was, noise apart
_KNOWN = 0.01  # relative error that the instant may leave
_STEPS = 41  # levels that are tried, twice
_LIKELY = 2.0  # log likelihood below the best up to which a level is within two standard errors
_FOLLOWED = 2.0  # noise levels up to which a run follows the rig
_APART = 5.0  # standard errors by which two levels differ for sure


@dataclass(frozen=True)
class Level:
    """A static level [N m] and its standard error."""

    value: float
    error: float


def levels(data: DrivenData, model: Model, starts: Sequence[Start]) -> dict[int, Level]:
    """Static level by direction, +1 and -1, where the recordings show it; the model's other numbers are taken as true.

    A rest that ends below what friction bore elsewhere was none: the hub had only been slow.
    """
    read: dict[int, list[Level]] = {1: [], -1: []}
    for prepared, view, start in zip(data.prepared, data.views, starts, strict=True):
        if prepared.hub is None:
            continue
        motion, _ = driven.move(view, prepared, model, start)
        for onset, direction in prepared.hub.onsets:
            run = _Run.of(model, prepared, motion, onset - BEFORE_ONSET, direction)
            level = _level(run) if run is not None else None
            if level is not None:
                read[direction].append(level)
    return {direction: together(seen) for direction, seen in read.items() if seen}


def together(seen: Sequence[Level]) -> Level:
    """One level of several: the mean of those that do not lie clearly below another."""
    highest = max(seen, key=lambda level: level.value - _APART * level.error)
    kept = [
        level for level in seen if highest.value - level.value < _APART * np.hypot(highest.error, level.error)
    ]
    weights = np.array([1 / level.error**2 for level in kept])
    value = float(weights @ [level.value for level in kept] / weights.sum())
    return Level(value, float(1 / np.sqrt(weights.sum())))


def _level(run: _Run) -> Level | None:
    """The level at which a run follows the rig; None where none does, or the torque that friction bore jumped."""
    torque, slope = run.borne()
    if slope * _INSTANT > _KNOWN * torque:
        return None
    centre = torque - run.raised
    half = max(slope * _LATE, _OFF * centre)
    for _ in range(2):
        values = centre + np.linspace(-half, half, _STEPS)
        # Below the Coulomb level a hub that has come free would rest and go on without end.
        values = values[values > run.coulomb]
        if not len(values):
            return None
        costs = np.array([run.cost(value) for value in values])
        likely = values[costs < costs.min() + _LIKELY]
        centre, half = float(likely.mean()), float(np.ptp(likely)) / 2 + 2 * half / (_STEPS - 1)
    if costs.min() > _FOLLOWED**2 * len(run.time) / 2:
        return None
    # Commands rise by stairs: between two of them all levels are alike.
    error = max(float(np.ptp(likely)) / np.sqrt(12), 2 * half / (_STEPS - 1))
    return Level(centre, float(np.hypot(error, slope * _INSTANT)))


@dataclass(frozen=True, eq=False)
class _Run:
    """A rig that comes free, from a rest on; n instants.

    Attributes:
      model: with which it is run.
      prepared: the recording.
      time: the first at rest, behind it those of the recording (n) [s].
      reading: of the hub (n) [rad]; none at the first.
      state: angles and rates of the plant at the first.
      end: index of the last at rest.
      direction: in which it comes free.
      raised: by which the level there exceeds the plant's own [N m].
    """

    model: Model
    prepared: Prepared
    time: np.ndarray
    reading: np.ndarray
    state: tuple[np.ndarray, np.ndarray]
    end: int
    direction: int
    raised: float

    @staticmethod
    def of(model: Model, prepared: Prepared, motion: Motion, last: int, direction: int) -> _Run | None:
        """The run about the end of a rest at a sample; None where that was no rest, or hardly a motion followed."""
        recording, hub = prepared.recording, prepared.hub
        assert hub is not None
        time = recording.time
        end = time[max(last, 0)]
        rest = (time > end - _REST) & (time <= end)
        if time[0] > end - _REST or not (hub.tight[rest] == STUCK).all():
            return None
        row = int(np.searchsorted(motion.time, end - _BEFORE))
        again = np.flatnonzero((time > end) & (time < end + _BEHIND) & (hub.observed == STUCK))
        rows = np.flatnonzero((time > motion.time[row]) & (time < end + _BEHIND))
        rows = rows[rows < again[0]] if len(again) else rows
        if (rows > last).sum() < _FEWEST:
            return None
        angles, rates = (planar.extended(model.plant, values[row]) for values in motion.state())
        resting = model.hub_angle_of(hub.reading, time)[rows[0]]
        own = model.plant.static_positive if direction > 0 else model.plant.static_negative
        return _Run(
            model,
            prepared,
            np.r_[motion.time[row], time[rows]],
            np.r_[np.nan, recording["hub_angle"][rows]],
            (angles + resting - angles[0], rates - rates[0]),
            int((rows <= last).sum()),
            direction,
            float(planar.static_level(model.plant, resting, direction) - own),
        )

    @property
    def coulomb(self) -> float:
        """The plant's own Coulomb level in the direction of the break-away [N m]."""
        plant = self.model.plant
        return plant.coulomb_positive if self.direction > 0 else plant.coulomb_negative

    def borne(self) -> tuple[float, float]:
        """Torque that friction bore at the end of the rest [N m], and how fast it grew [N m/s]."""
        rest = slice(0, self.end + 1)
        firm = self.model.plant._replace(static_positive=planar.FIRM, static_negative=planar.FIRM)
        angles, rates, _ = self._moved(firm, rest)
        drive = self.model.drive(self.prepared.recording).at(self.time[rest])
        torque = self.direction * planar.holding_torque(firm, self.time[rest], angles, rates, drive)
        half = len(torque) // 2
        span = self.time[self.end] - self.time[self.end - half]
        return float(torque[-1]), abs(float(torque[-1] - torque[-1 - half])) / float(span)

    def cost(self, level: float) -> float:
        """Minus the log likelihood of the readings under a static level [N m]."""
        own = self.model.plant
        plant = (
            own._replace(static_positive=level) if self.direction > 0 else own._replace(static_negative=level)
        )
        motion = Motion.of(self.time, *self._moved(plant), len(self.model.chain.lengths))
        told = reported(self.model, Recording("", self.time, {"hub_angle": self.reading}), motion)
        missing = (self.reading - told["hub_angle"]) / self.prepared.noise["hub_angle"]
        return 0.5 * float(np.nansum(missing**2))

    def _moved(
        self, plant: planar.Plant, rows: slice = slice(None)
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, rates and modes of a plant at some of the instants."""
        lagging, times, torques = self._drive
        plant = plant._replace(lag=lagging.lag)
        step = self.model.stable_step
        return planar.simulate(plant, times, torques, self.time[rows], *self.state, 0, False, step)

    @functools.cached_property
    def _drive(self) -> tuple[planar.Plant, np.ndarray, np.ndarray]:
        """What all levels have in common: see `delivered`."""
        return delivered(self.model, self.prepared.recording)
