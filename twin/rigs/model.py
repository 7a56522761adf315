"""The twin as one value: a rig, the effects added to it, and what its sensors would report."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from twin.effects import REGISTRY, Drive
from twin.mechanics import chain
from twin.mechanics.chain import Chain, ChainShape
from twin.mechanics.hub_law import HubTorque, as_arrays
from twin.mechanics.plant import Plant, declared_plant
from twin.parameters import Rig
from twin.recording import Recording, Sensor
from twin.rigs.drive_law import through
from twin.rigs.patch import Patch

Effects = Mapping[str, Mapping[str, float]]
"""Effect name -> parameter name -> value, SI."""


@dataclass(frozen=True)
class Model:
    """A rig with effects.

    Attributes:
      declared: the rig without effects.
      sensors: channel -> how it is measured.
      shape: proportions of the chain.
      effects: effects that act, with their parameters.
      step: largest integration step [s].
      late: how much later than stamped a card puts its commands out [s].
      patch: a correction without a cause, looked up; None for none.
      friction: fields of `Friction` that are set, whatever rig and effects say.
      break_away: factor on the static levels.
    """

    declared: Rig
    sensors: Mapping[str, Sensor]
    shape: ChainShape
    effects: Effects = field(default_factory=dict)
    step: float = 1e-3
    late: float = 0.0
    patch: Patch | None = None
    friction: Mapping[str, float] = field(default_factory=dict)
    break_away: float = 1.0

    def replace(self, **changes) -> Model:
        """Returns a model with some attributes changed."""
        return replace(self, **changes)

    @functools.cached_property
    def rig(self) -> Rig:
        """The rig with what the effects change in it."""
        rig = self.declared
        for name, p in self.effects.items():
            rig = REGISTRY[name].rig(rig, p)
        return rig

    @functools.cached_property
    def chain(self) -> Chain:
        """The chain of `rig` with what the effects change in it."""
        links = chain.build(self.rig, shape=self.shape)
        for name, p in self.effects.items():
            links = REGISTRY[name].links(links, self.rig, p)
        return links

    @functools.cached_property
    def gauge_rows(self) -> dict[str, np.ndarray]:
        """Channel -> row from hinge angles, the clamp rigid, to the curvature at its gauge [1/m per rad]."""
        gauges = {name: s for name, s in self.sensors.items() if s.half_thickness}
        links = self.chain.rigid or self.chain
        return {name: self.gauge_row(links, s.position) for name, s in gauges.items()}

    def gauge_row(self, links: Chain, x: float) -> np.ndarray:
        """Row (n) from hinge angles of links on a rigid clamp to the curvature at x [1/m per rad]."""
        return chain.curvature_row(links, self.rig, x)

    @functools.cached_property
    def curvature_rows(self) -> dict[str, np.ndarray]:
        """Channel -> row (n) from hinge angles to the curvature at its gauge [1/m per rad]."""
        return {name: chain.through_root(self.chain, row) for name, row in self.gauge_rows.items()}

    @functools.cached_property
    def curvature_rate_rows(self) -> dict[str, np.ndarray]:
        """Channel -> row (n) from hinge rates to the curvature at its gauge [s/m per rad], where there is one."""
        rows = {name: chain.lagging_row(self.chain, row) for name, row in self.gauge_rows.items()}
        return {name: row for name, row in rows.items() if row is not None}

    @functools.cached_property
    def plant(self) -> Plant:
        """What the equations of motion read."""
        plant = declared_plant(self.rig, self.chain)
        for name, p in self.effects.items():
            plant = REGISTRY[name].plant(plant, p)
        friction = plant.friction._replace(**self.friction)
        if self.break_away != 1:
            friction = friction.scaled(self.break_away)
        return plant._replace(friction=friction, torques=as_arrays(self.hub_torques))

    @functools.cached_property
    def hub_torques(self) -> tuple[HubTorque, ...]:
        """Torques on the hub that effects and patch add."""
        found = [REGISTRY[name].hub_torque(p) for name, p in self.effects.items()]
        found += [self.patch.hub_torque()] if self.patch is not None else []
        return tuple(torque for torque in found if torque is not None)

    def plant_of(self, recording: Recording) -> Plant:
        """The plant, time of its torques counted from the first sample of a recording."""
        return self.plant._replace(torques=self.plant.torques._replace(since=float(recording.time[0])))

    @property
    def link_step(self) -> float:
        """Integration step [s] of the link by itself: `step`, or less where the chain asks for less."""
        return min(self.step, self.chain.largest_step())

    @property
    def stable_step(self) -> float:
        """Integration step [s]: `link_step`, or less where what stands behind the chain asks for less."""
        return min(self.link_step, self.plant.largest_step)

    def with_friction(self, **levels: float) -> Model:
        """A model with some fields of its `Friction` set, whatever rig and effects say; they stay set."""
        return self.replace(friction={**self.friction, **levels})

    def with_break_away(self, share: float) -> Model:
        """A model whose static levels are so many times as large, see `Friction.scaled`; they stay so."""
        return self.replace(break_away=share * self.break_away)

    def drive(self, recording: Recording) -> Drive:
        """Delivered torque of a recording's command: saturated, then through the effects of the drive."""
        limit = self.declared["torque_limit"]
        put_out = recording.commanded_at + self.late
        command = through(self.effects, Drive(put_out, np.clip(recording["torque_command"], -limit, limit)))
        if self.patch is not None:
            command = command.replace(torque=self.patch.on_command(command.torque))
        return command

    @property
    def torque_gain(self) -> float:
        """Torque that is delivered for one that is commanded [1], whatever else is added to it."""
        steps = through(self.effects, Drive(np.arange(2.0), np.arange(2.0)))
        return float(np.diff(steps.torque)[0])

    def read_torque(self, recording: Recording) -> np.ndarray:
        """Delivered torque at the samples of a recording: a card reads it as it puts its commands out."""
        return self.drive(recording).at(recording.commanded_at + self.late)

    def report(self, time: np.ndarray, true: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """What the sensors report of true channel values (name -> (m,), SI), `time` from the start of a recording."""
        for name, p in self.effects.items():
            true = REGISTRY[name].sensing(time, true, p)
        return true if self.patch is None else self.patch.on_reading(time, true)

    @property
    def hub_late(self) -> float:
        """By how much the hub's reading lags behind its angle [s]: what it does in the end is not read any more."""
        return sum(REGISTRY[name].hub_delay(p) for name, p in self.effects.items())

    def hub_angle_of(self, reading: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Hub angle (m,) that the sensor reports as `reading`."""
        for name, p in reversed(list(self.effects.items())):
            reading = REGISTRY[name].hub_angle_of(time, reading, p)
        return reading


FINE_SEGMENTS, FINE_STEP = 12, 2.5e-4


def fine(model: Model) -> Model:
    """The same model on a chain fine enough to stand for the limit."""
    return model.replace(shape=_fine_shape(model), step=FINE_STEP)


def _fine_shape(model: Model) -> ChainShape:
    # A shape fits all rigs that are much alike: fitted to three digits, it is found again.
    rounded = {name: float(f"{model.rig[name]:.2g}") for name in chain.SHAPED_BY}
    return chain.fit_shape(rounded, FINE_SEGMENTS)
