"""Runs that begin in a measured rest and leave it: what a hub does in the moments after it comes free.

What the link does until then follows from the measured hub, and the run ends before that comes to rest again: nothing
else that sticks or slips enters.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from twin.campaigns.rests import SAMPLES_BEFORE_ONSET
from twin.mechanics import planar
from twin.mechanics.planar import STUCK
from twin.mechanics.plant import IMMOVABLE, Plant
from twin.mechanics.state import Motion
from twin.recording import Recording
from twin.residuals.prepared import Prepared
from twin.rigs.model import Model
from twin.rigs.simulate import delivered_torque, sensor_readings

REST = 0.2
"""Span before a break-away in which the hub has to rest [s]."""
BEFORE = 0.06
"""Span before a break-away from which on it is run, from beyond the reach of the filter [s]."""
_BEHIND = 0.06  # s behind it that are run, too
_FEWEST = 8  # readings behind the break-away that tell its instant
INSTANT = 5e-4
"""To which a model tells when a hub came free, noise apart [s]."""
_KNOWN = 0.01  # relative error that the instant may leave
_ABOVE = 1.001  # times the Coulomb level, the least that a static level is
_JUMP = 0.1  # part of the torque borne, beyond which a change from one sample to the next is no slow growth


@dataclass(frozen=True, eq=False)
class RestRun:
    """A rig that comes free, from a rest on; n instants.

    Attributes:
      model: with which it is run.
      prepared: the recording.
      plant: of the model; a motor with play pushes from its flank as long as a torque grows.
      time: the first at rest, behind it those of the recording (n) [s].
      reading: of the hub (n) [rad]; none at the first.
      state: angles and rates of the plant at the first.
      end: index of the last at rest.
      direction: in which it comes free.
      level: of the model's static friction there, in that direction [N m].
    """

    model: Model
    prepared: Prepared
    plant: Plant
    time: np.ndarray
    reading: np.ndarray
    state: tuple[np.ndarray, np.ndarray]
    end: int
    direction: int
    level: float

    @staticmethod
    def of(model: Model, prepared: Prepared, motion: Motion, onset: int, direction: int) -> RestRun | None:
        """The run about the sample at which a motion is first seen; None without a rest before, or if it was short."""
        recording, hub = prepared.recording, prepared.hub
        assert hub is not None
        time, last = recording.time, onset - SAMPLES_BEFORE_ONSET
        end = time[max(last, 0)]
        rest = (time > end - REST) & (time <= end)
        if time[0] > end - REST or not (hub.tight[rest] == STUCK).all():
            return None
        row = int(np.searchsorted(motion.time, end - BEFORE))
        again = np.flatnonzero((time > end) & (time < end + _BEHIND) & (hub.observed == STUCK))
        known = np.isfinite(recording["hub_angle"])
        rows = np.flatnonzero((time > motion.time[row]) & (time < end + _BEHIND) & known)
        rows = rows[rows < again[0]] if len(again) else rows
        if (rows > last).sum() < _FEWEST:
            return None
        plant = model.plant_of(recording).with_backlash_closed()
        angles, rates = (plant.extend_state(values[row]) for values in motion.state())
        resting = model.hub_angle_of(hub.reading, time)[rows[0]]
        return RestRun(
            model,
            prepared,
            plant,
            np.r_[motion.time[row], time[rows]],
            np.r_[np.nan, recording["hub_angle"][rows]],
            (angles + resting - angles[0], rates - rates[0]),
            int((rows <= last).sum()),
            direction,
            float(planar.static_level(plant, resting, direction)),
        )

    @property
    def end_of_rest(self) -> float:
        """The last instant at which the hub surely rested [s]."""
        return float(self.time[self.end])

    @property
    def raised(self) -> float:
        """By which the level there exceeds the plant's own [N m]."""
        return self.level - self.plant.friction.levels(self.direction)[0]

    @property
    def coulomb(self) -> float:
        """The plant's own Coulomb level in the direction of the break-away [N m]."""
        return self.plant.friction.levels(self.direction)[1]

    @functools.cached_property
    def borne(self) -> tuple[float, float]:
        """Torque that friction bore at the end of the rest [N m], and how fast it grew [N m/s]."""
        rest = self.time[: self.end + 1]
        firm = self.plant.with_friction(static_positive=IMMOVABLE, static_negative=IMMOVABLE)
        angles, rates, _ = self._moved(firm, rest)
        drive = self.model.drive(self.prepared.recording).at(rest)
        torque = self.direction * planar.holding_torque(firm, rest, angles, rates, drive)
        half = len(torque) // 2
        return float(torque[-1]), abs(float(torque[-1] - torque[-1 - half])) / float(
            rest[-1] - rest[-1 - half]
        )

    @property
    def is_slow(self) -> bool:
        """Whether the torque grew so slowly that the instant at which the hub came free tells the level."""
        torque, slope = self.borne
        about = self.model.drive(self.prepared.recording).at(self.time[: self.end + SAMPLES_BEFORE_ONSET + 1])
        return slope * INSTANT < _KNOWN * torque and np.abs(np.diff(about)).max() < _JUMP * torque

    def readings(self, level: float, time: np.ndarray) -> np.ndarray:
        """The hub (n) as its sensor reports it under a static level [N m], at instants from the first on (n) [s]."""
        # Below the Coulomb level a hub that has come free would rest and go on without end.
        own = self.plant.friction
        ahead, back = (level, own.static_negative) if self.direction > 0 else (own.static_positive, level)
        plant = self.plant.with_friction(
            static_positive=max(ahead, _ABOVE * own.coulomb_positive),
            static_negative=max(back, _ABOVE * own.coulomb_negative),
        )
        motion = Motion.from_coordinates(time, *self._moved(plant, time), len(self.model.chain.lengths))
        return sensor_readings(self.model, Recording("", time, {"hub_angle": time}), motion)["hub_angle"]

    def _moved(self, plant: Plant, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, rates and modes of a plant at some instants."""
        lagging, times, torques = self._drive
        plant = plant.with_motor(lag=lagging.motor.lag)
        return planar.simulate(plant, times, torques, time, *self.state, 0, False, self.model.link_step)

    @functools.cached_property
    def _drive(self) -> tuple[Plant, np.ndarray, np.ndarray]:
        """What all levels have in common: see `delivered`."""
        return delivered_torque(self.model, self.prepared.recording)
