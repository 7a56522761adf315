"""Simulations that begin in a measured rest of the hub and run through its end, the break-away.

Until the break-away the link moves as the measured hub makes it, and the simulation ends before the hub comes to rest
again: no other stick or slip enters.
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
from twin.residuals.prepared import MIN_READINGS, Prepared
from twin.rigs.model import Model
from twin.rigs.simulate import delivered_torque, sensor_readings

REST_SPAN = 0.2
"""Span before a break-away in which the hub has to rest [s]."""
LEAD_SPAN = 0.06
"""Span before and behind a break-away that is compared [s]: the filter's response is at 1 % there.

A run is simulated from this long after the beginning of the rest. A hub may creep unseen before it visibly moves: under
a torque that grows by 0.02 N m/s for 70 ms, and then a run that began at rest 60 ms before was off by 0.7 noise levels,
and a Stribeck velocity by 3 % (by hand)."""
INSTANT_ERROR = 5e-4
"""Error of the instant of a break-away by the model, noise apart [s]."""
MAX_LEVEL_ERROR = 0.01  # relative error of the level up to which a torque counts as slow
_MAX_JUMP = 0.1  # change of the torque between samples, relative to it, up to which its growth counts as slow


@dataclass(frozen=True, eq=False)
class RestRun:
    """A rig about one break-away, from its rest on; n instants.

    Attributes:
      model: that is simulated.
      prepared: the recording.
      plant: equations of motion of the model; a motor with backlash stays on its flank while a torque grows.
      time: an instant at rest, from which the simulation starts, and the known samples that follow (n) [s].
      reading: of the hub (n) [rad]; not a number at the first instant.
      state: angles [rad] and rates [rad/s] of the plant at the first instant.
      end: index of the last instant at rest.
      direction: of the motion behind the break-away, +1 or -1.
      level: static friction level of the model at the angle of the rest, in that direction [N m].
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
        """The run about one break-away; None if the rest before it or the motion behind it is too short.

        Args:
          model: to simulate.
          prepared: the recording.
          motion: of the link under the measured hub, on the grid.
          onset: sample at which the hub visibly moves.
          direction: of its motion, +1 or -1.
        """
        recording, hub = prepared.recording, prepared.hub
        assert hub is not None
        time, last = recording.time, onset - SAMPLES_BEFORE_ONSET
        end = time[max(last, 0)]
        rest = (time > end - REST_SPAN) & (time <= end)
        if time[0] > end - REST_SPAN or not (hub.tight[rest] == STUCK).all():
            return None
        row = int(np.searchsorted(motion.time, end - (REST_SPAN - LEAD_SPAN)))
        again = np.flatnonzero((time > end) & (time < end + LEAD_SPAN) & (hub.observed == STUCK))
        known = np.isfinite(recording["hub_angle"])
        rows = np.flatnonzero((time > end - LEAD_SPAN) & (time < end + LEAD_SPAN) & known)
        rows = rows[rows < again[0]] if len(again) else rows
        if (rows > last).sum() < 2 * MIN_READINGS or (rows <= last).sum() < 2:
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
        """The last instant at rest [s]."""
        return float(self.time[self.end])

    @property
    def level_offset(self) -> float:
        """Static level at the angle of the rest less the plant's level there without position dependence [N m]."""
        return self.level - self.plant.friction.levels(self.direction)[0]

    @property
    def coulomb(self) -> float:
        """The plant's Coulomb level in the direction of the break-away, without position dependence [N m]."""
        return self.plant.friction.levels(self.direction)[1]

    @functools.cached_property
    def holding_torque(self) -> tuple[float, float]:
        """Torque that friction holds at the end of the rest [N m], and the rate at which it grows [N m/s]."""
        rest = self.time[: self.end + 1]
        firm = self.plant.with_friction(static_positive=IMMOVABLE, static_negative=IMMOVABLE)
        angles, rates, _ = self._simulated(firm, rest)
        drive = self.model.drive(self.prepared.recording).at(rest)
        torque = self.direction * planar.holding_torque(firm, rest, angles, rates, drive)
        half = len(torque) // 2
        growth, span = float(torque[-1] - torque[-1 - half]), float(rest[-1] - rest[-1 - half])
        return float(torque[-1]), abs(growth) / span

    @property
    def is_slow(self) -> bool:
        """Whether the torque grows so slowly that the instant of the break-away determines the static level."""
        torque, slope = self.holding_torque
        about = self.model.drive(self.prepared.recording).at(
            self.time[1 : self.end + SAMPLES_BEFORE_ONSET + 1]
        )
        return (
            slope * INSTANT_ERROR < MAX_LEVEL_ERROR * torque
            and np.abs(np.diff(about)).max() < _MAX_JUMP * torque
        )

    def readings(self, level: float, time: np.ndarray) -> np.ndarray:
        """Simulated readings of the hub (k) [rad].

        Args:
          level: static friction level in the direction of the break-away, without position dependence [N m].
          time: instants (k), the first of them that of the run [s].
        """
        # A static level below the Coulomb level would stop the hub at once, again and again.
        own = self.plant.friction
        ahead, back = (level, own.static_negative) if self.direction > 0 else (own.static_positive, level)
        plant = self.plant.with_friction(
            static_positive=max(ahead, own.coulomb_positive),
            static_negative=max(back, own.coulomb_negative),
        )
        motion = Motion.from_coordinates(time, *self._simulated(plant, time), len(self.model.chain.lengths))
        return sensor_readings(self.model, Recording("", time, {"hub_angle": time}), motion)["hub_angle"]

    def _simulated(self, plant: Plant, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, rates and friction modes of a plant at some instants, the first of them that of the run."""
        lagging, times, torques = self._drive
        plant = plant.with_motor(lag=lagging.motor.lag)
        return planar.simulate(plant, times, torques, time, *self.state, 0, False, self.model.stable_step)

    @functools.cached_property
    def _drive(self) -> tuple[Plant, np.ndarray, np.ndarray]:
        """Delivered torque, the same for all levels: see `twin.rigs.simulate.delivered_torque`."""
        return delivered_torque(self.model, self.prepared.recording)
