"""The model of a rig as one immutable value: parameters, effects, chain; derived quantities are cached properties."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np

from twin.effects import REGISTRY, Drive
from twin.mechanics import chain
from twin.mechanics.chain import Chain, ChainShape
from twin.mechanics.hub_law import HubTorque, as_arrays
from twin.mechanics.plant import Plant, declared_plant
from twin.parameters import Rig
from twin.recording import Recording, Sensor
from twin.rigs.channel_errors import COMMAND, ChannelErrors
from twin.rigs.check import check_gauges, check_parameters
from twin.rigs.drive_law import apply_drive_effects
from twin.rigs.patch import Patch

_FAR = 1024.0  # N m, a command far beyond any dead zone; a power of two, so that gains stay exact
BREAK_AWAY_CHANGE = 1e-3
"""Relative change of the break-away torque by which simulations are tried for repeatability."""
Effects = Mapping[str, Mapping[str, float]]
"""Effect name -> parameter name -> value, SI."""


@dataclass(frozen=True)
class Model:
    """A rig with effects.

    Attributes:
      declared: the rig without effects.
      sensors: channel -> how it is measured.
      shape: proportions of the chain.
      effects: effects with their parameters, applied in this order.
      step: largest integration step [s].
      late: delay of the card's output: commands act this much later than their time stamps [s].
      patch: empirical lookup table added to the hub torque or a reading; None for none.
      friction: fields of `Friction` that override those of rig and effects.
      break_away: factor on the static friction levels [1].
      channel_errors: gains and delays of measured channels.
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
    channel_errors: ChannelErrors = ChannelErrors()

    def replace(self, **changes) -> Model:
        """Returns a model with some attributes changed."""
        return replace(self, **changes)

    def __reduce__(self):
        # Derived quantities are computed again, and a read-only mapping cannot be copied to another process.
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return functools.partial(type(self), **{**values, "sensors": dict(self.sensors)}), ()

    @functools.cached_property
    def rig(self) -> Rig:
        """The rig's parameters with the effects applied."""
        rig = self.declared
        for name, p in self.effects.items():
            rig = REGISTRY[name].rig(rig, p)
        return rig

    @functools.cached_property
    def chain(self) -> Chain:
        """The chain of `rig` with the effects applied."""
        links = chain.build(self.rig, shape=self.shape)
        for name, p in self.effects.items():
            links = REGISTRY[name].links(links, self.rig, p)
        return links

    @functools.cached_property
    def gauge_rows(self) -> dict[str, np.ndarray]:
        """Channel -> row from hinge angles, on a rigid clamp, to the curvature at its gauge [1/m per rad]."""
        gauges = {name: s for name, s in self.sensors.items() if s.half_thickness}
        links = self.chain.rigid or self.chain
        return {name: self.gauge_row(links, s.position) for name, s in gauges.items()}

    def gauge_row(self, links: Chain, x: float) -> np.ndarray:
        """Returns the row (n) from hinge angles of a chain on a rigid clamp to the curvature at x [m] [1/m per rad]."""
        # A fit may shorten the link to less than the position of a gauge at its end.
        return chain.curvature_row(links, self.rig, min(x, self.rig["length"]))

    @functools.cached_property
    def curvature_rows(self) -> dict[str, np.ndarray]:
        """Channel -> row (n) from hinge angles to the curvature at its gauge [1/m per rad]."""
        return {
            name: chain.row_with_root_compliance(self.chain, row) for name, row in self.gauge_rows.items()
        }

    @functools.cached_property
    def strain_rows(self) -> dict[str, np.ndarray]:
        """Channel -> row (n) from hinge angles to the strain at its gauge [1/rad]."""
        return {name: self.sensors[name].half_thickness * row for name, row in self.curvature_rows.items()}

    @property
    def link_rows(self) -> dict[str, np.ndarray]:
        """Channel -> row (n) from small hinge angles to its strain [1/rad] or tip deflection [m/rad]."""
        return {**self.strain_rows, "tip_deflection": self.chain.levers}

    @functools.cached_property
    def curvature_rate_rows(self) -> dict[str, np.ndarray]:
        """Channel -> row (n) from hinge rates to the curvature at its gauge [s/m per rad], if it depends on them."""
        rows = {name: chain.curvature_rate_row(self.chain, row) for name, row in self.gauge_rows.items()}
        return {name: row for name, row in rows.items() if row is not None}

    @functools.cached_property
    def plant(self) -> Plant:
        """The numbers of the equations of motion, with the effects applied."""
        plant = declared_plant(self.rig, self.chain)
        for name, p in self.effects.items():
            plant = REGISTRY[name].plant(plant, p)
        friction = plant.with_friction(**self.friction).friction
        if self.break_away != 1:
            friction = friction.scaled(self.break_away)
        return plant._replace(friction=friction, torques=as_arrays(self.hub_torques))

    @functools.cached_property
    def hub_torques(self) -> tuple[HubTorque, ...]:
        """Torques on the hub that effects and patch add."""
        torques = [REGISTRY[name].hub_torque(p) for name, p in self.effects.items()]
        torques += [self.patch.hub_torque()] if self.patch is not None else []
        acting = [torque for torque in torques if torque is not None]
        for name, p in self.effects.items():
            acting = [REGISTRY[name].placed(torque, p) for torque in acting]
        return tuple(acting)

    def plant_of(self, recording: Recording) -> Plant:
        """Returns the plant with the time of hub torques and a shaken base counted from a recording's first sample."""
        plant, since = self.plant, float(recording.time[0])
        phase = plant.link.shake_phase - 2 * math.pi * plant.link.shake_frequency * since
        return plant.with_link(shake_phase=phase)._replace(torques=plant.torques._replace(since=since))

    @property
    def stable_step(self) -> float:
        """Integration step [s]: `step`, or the limit at which the chain is stable."""
        return min(self.step, self.chain.largest_step())

    def with_friction(self, **levels: float) -> Model:
        """Returns a model with some fields of its `Friction` set, overriding rig and effects."""
        return self.replace(friction={**self.friction, **levels})

    def with_break_away(self, share: float) -> Model:
        """Returns a model with its static friction levels multiplied by `share`; see `Friction.scaled`."""
        return self.replace(break_away=share * self.break_away)

    def drive(self, recording: Recording) -> Drive:
        """Delivered torque for a recording's command: limited by the amplifier, then changed by the drive's effects."""
        limit = self.declared["torque_limit"]
        held, torque = recording.commands
        put_out = held + self.late + self.channel_errors.delays.get(COMMAND, 0.0)
        command = self._delivered(Drive(put_out, np.clip(torque, -limit, limit)))
        if self.patch is not None:
            command = command.replace(torque=self.patch.on_command(command.torque))
        return command

    @property
    def torque_gain(self) -> float:
        """Delivered torque per commanded torque far beyond any dead zone [1], without bias."""
        far = np.array([_FAR, 2 * _FAR])
        steps = self._delivered(Drive(np.arange(2.0), far))
        return float(np.diff(steps.torque)[0]) / _FAR

    def _delivered(self, command: Drive) -> Drive:
        """Delivered torque for a command behind the limit of the amplifier."""
        return self.channel_errors.driven(apply_drive_effects(self.effects, command))

    def read_torque(self, recording: Recording) -> np.ndarray:
        """Delivered torque (m) [N m] at the samples of a recording; a card reads it when it outputs its commands."""
        read = self.drive(recording).at(recording.commanded_at + self.late)
        sensor = self.sensors.get("motor_torque")
        # Before the error of the gain stands a sensor of the current.
        before = sensor is not None and sensor.sees_gain is False
        return read / self.channel_errors.gains.get(COMMAND, 1.0) if before else read

    def report(self, time: np.ndarray, true: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Returns the readings of true channel values (name -> (m), SI), `time` [s] from the start of a recording."""
        for name, p in self.effects.items():
            true = REGISTRY[name].sensing(time, true, p)
        true = self.channel_errors.read(time, true)
        return true if self.patch is None else self.patch.on_reading(time, true)

    @property
    def hub_late(self) -> float:
        """Delay of the hub's reading [s]; the last motion of a recording within it is not measured."""
        own = self.channel_errors.delays.get("hub_angle", 0.0)
        return own + sum(REGISTRY[name].hub_delay(p) for name, p in self.effects.items())

    def hub_angle_of(self, reading: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Returns the hub angle (m) [rad] for which the sensor reports `reading` (m)."""
        reading = self.channel_errors.value_of("hub_angle", time, reading)
        for name, p in reversed(list(self.effects.items())):
            reading = REGISTRY[name].hub_angle_of(time, reading, p)
        return reading


class FixedStepModel(Model):
    """A model that is stable with its step: modes of the chain that are too fast for it are slowed down to it."""

    @functools.cached_property
    def chain(self) -> Chain:
        """See `Model.chain` and `Chain.with_slower_modes`."""
        return super().chain.with_slower_modes(self.step)


def checked_model(model: Model) -> Model:
    """Returns the model; raises InputError where its rig, with its effects, cannot be simulated."""
    check_parameters(model.rig)
    check_gauges(model.rig, model.sensors.values())
    return model


FINE_SEGMENTS, FINE_STEP = 12, 2.5e-4
"""Segments and largest step [s] of a chain whose discretisation error is taken as negligible."""


def with_fine_chain(model: Model) -> Model:
    """Returns the model on a chain whose discretisation error is taken as negligible."""
    shape = chain.fit_shape_of_similar_rig(model.rig, FINE_SEGMENTS)
    return model.replace(shape=shape, step=FINE_STEP)
