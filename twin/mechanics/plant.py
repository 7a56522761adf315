"""What the equations of motion of the chain read, as one value: link, friction, motor, torques on the hub.

Arrays are for n hinges and n + 1 segments. Extra coordinates stand behind the segments where an effect asks for them:
the absolute angle of an oscillator on the hub (a torsional mode), then that of a motor with play between it and the
hub.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from twin.mechanics.chain import Chain
from twin.mechanics.hub_law import NO_TORQUES, Torques

IMMOVABLE = 1e9
"""Static level of a hub that no torque moves out of a rest [N m]."""

CONTACT_STIFFNESS = 1000.0
"""Of the flanks of a backlash [N m/rad]: the largest torque of a motor like this turns them by 0.01 degrees."""
CONTACT_LOSS = 0.2
"""Damping ratio of the motor's inertia on a flank: it comes back with half of its speed, as steel on steel."""
CONTACT_STEP = 1e-4
"""Largest step with which the motor is followed through a contact of some 2 ms [s]."""


class Link(NamedTuple):
    """Link, payload and oscillators: all on which their motion depends where that of the hub is given; SI units.

    Neutral values switch a mechanism off.
    """

    lengths: np.ndarray  # (n + 1) m
    inertia: np.ndarray  # (n + 1, n + 1) kg m^2, c_ij
    stiffness: np.ndarray  # (n) N m/rad
    damping: np.ndarray  # (n, n) N m s/rad, on the hinge rates
    first_moment: np.ndarray  # (n + 1) kg m, sum of mass times lever along segment i
    flexibility: float  # 1/(N m^2), curvature of the link per bending moment
    drag_linear: float = 0.0  # N s/m, of the tip
    drag_quadratic: float = 0.0  # N s^2/m^2
    softening: float = 0.0
    softening_curvature: float = 1.0  # 1/m
    gravity_x: float = 0.0  # m/s^2
    gravity_y: float = 0.0
    shake_x: float = 0.0  # m/s^2, amplitude of an acceleration of the base
    shake_y: float = 0.0
    shake_frequency: float = 1.0  # Hz
    shake_phase: float = 0.0
    torsion_stiffness: float = 0.0  # N m/rad, of an oscillator on the hub
    torsion_damping: float = 0.0  # N m s/rad

    @property
    def is_shaken(self) -> bool:
        """Whether its base is accelerated."""
        return self.shake_x != 0 or self.shake_y != 0

    @property
    def curvature_per_angle(self) -> np.ndarray:
        """Curvature that a hinge angle stands for (n) [1/m per rad]: none at a clamp that gives, on the hub's axis."""
        return np.where(self.lengths[: len(self.stiffness)] > 0, self.flexibility * self.stiffness, 0.0)

    @property
    def mechanisms(self) -> dict[str, float]:
        """What acts on the link beyond its own inertia, stiffness and damping, as far as it depends on its state."""
        own = ("flexibility", "shake_x", "shake_y", "shake_frequency", "shake_phase")
        return {n: v for n, v in self._asdict().items() if n not in own and not isinstance(v, np.ndarray)}


class Friction(NamedTuple):
    """Dry friction of the hub [N m]: levels of each direction, static and Coulomb, and how they vary.

    Both are raised by amplitude (1 + sin(order theta + phase))/2; the sliding level falls from the static to the
    Coulomb one as exp(-(omega/stribeck_velocity)^2), at once where that velocity is 0.
    """

    static_positive: float = 0.0
    static_negative: float = 0.0
    coulomb_positive: float = 0.0
    coulomb_negative: float = 0.0
    stribeck_velocity: float = 0.0  # rad/s
    amplitude: float = 0.0
    order: float = 1.0
    phase: float = 0.0

    def levels(self, direction: float) -> tuple[float, float]:
        """Static and Coulomb level in a direction, +1 or -1, before any raise [N m]."""
        if direction > 0:
            return self.static_positive, self.coulomb_positive
        return self.static_negative, self.coulomb_negative

    def scaled(self, share: float) -> Friction:
        """Friction whose static levels are so many times as large: at least the Coulomb ones.

        A hub that came free below what it slides against would stop at once, and come free again, without end.
        """
        return self._replace(
            static_positive=max(share * self.static_positive, self.coulomb_positive),
            static_negative=max(share * self.static_negative, self.coulomb_negative),
        )


class Motor(NamedTuple):
    """The motor: lag of its torque, and its play against the hub; neutral values are none."""

    lag: float = 0.0  # s
    gap: float = 0.0  # rad, whole play between motor and hub
    inertia: float = 0.0  # kg m^2, of a motor with play; `Link.inertia` has it already
    contact_loss: float = CONTACT_LOSS  # damping ratio of a motor with play on its flanks


class Plant(NamedTuple):
    """Everything the equations of motion read, SI units.

    Attributes:
      link: link and payload.
      friction: of the hub.
      motor: lag and play.
      torques: on the hub, beside drive and friction.
      hub_inertia: as declared [kg m^2]; `link.inertia` has it already.
    """

    link: Link
    friction: Friction = Friction()
    motor: Motor = Motor()
    torques: Torques = NO_TORQUES
    hub_inertia: float = 0.0

    def with_link(self, **changes: Any) -> Plant:
        """A plant with some fields of its link changed."""
        return self._replace(link=self.link._replace(**changes))

    def with_friction(self, **changes: float) -> Plant:
        """A plant with some fields of its friction changed."""
        return self._replace(friction=self.friction._replace(**changes))

    def with_motor(self, **changes: float) -> Plant:
        """A plant with some fields of its motor changed."""
        return self._replace(motor=self.motor._replace(**changes))

    def with_torsion(self, inertia: float, stiffness: float, damping: float) -> Plant:
        """A plant with an oscillator on the hub, whose inertia [kg m^2] is taken from the hub's."""
        # It stands before the motor, which keeps the last place.
        place = len(self.link.lengths) - (1 if self.motor.gap > 0 else 0)
        added = self._with_extra(inertia, place)
        return added.with_link(torsion_stiffness=stiffness, torsion_damping=damping)

    def with_backlash(self, gap: float, motor_inertia: float, loss: float = CONTACT_LOSS) -> Plant:
        """A plant whose motor has a play against the hub.

        Args:
          gap: the play in all [rad].
          motor_inertia: the motor's part of the hub's inertia [kg m^2].
          loss: damping ratio of the motor on the flanks [1].
        """
        behind = self._with_extra(motor_inertia, len(self.link.lengths))
        return behind.with_motor(gap=gap, inertia=motor_inertia, contact_loss=loss)

    def without_motor(self) -> Plant:
        """What is behind the play: the same plant where it has none, else the hub without the motor."""
        if self.motor.gap <= 0:
            return self
        behind = self.with_link(
            lengths=self.link.lengths[:-1],
            inertia=np.ascontiguousarray(self.link.inertia[:-1, :-1]),
            first_moment=self.link.first_moment[:-1],
        )
        return behind.with_motor(gap=0.0)._replace(torques=self.torques.select(~self.torques.on_motor))

    def with_backlash_closed(self) -> Plant:
        """A plant whose motor stays on the flank that pushes: the same where it has no play."""
        if self.motor.gap <= 0:
            return self
        behind = self.without_motor()
        inertia = behind.link.inertia.copy()
        inertia[0, 0] += self.motor.inertia
        return behind.with_link(inertia=inertia).with_motor(inertia=0.0)._replace(torques=self.torques)

    @property
    def largest_step(self) -> float:
        """Longest step [s] that the extra coordinates allow."""
        return CONTACT_STEP if self.motor.gap > 0 else np.inf

    def extend_state(self, state: np.ndarray) -> np.ndarray:
        """A state (n + 1) of the link as one of the plant: extra coordinates move with the hub."""
        return np.r_[state, np.full(len(self.link.lengths) - len(state), state[0])]

    def _with_extra(self, inertia: float, place: int) -> Plant:
        """A plant with one more coordinate on the hub's axis, its inertia [kg m^2] taken from the hub's."""
        matrix = np.insert(np.insert(self.link.inertia, place, 0.0, axis=0), place, 0.0, axis=1)
        matrix[0, 0] -= inertia
        matrix[place, place] = inertia
        return self.with_link(
            lengths=np.insert(self.link.lengths, place, 0.0),
            inertia=np.ascontiguousarray(matrix),
            first_moment=np.insert(self.link.first_moment, place, 0.0),
        )


def declared_plant(rig: Mapping[str, float], chain: Chain) -> Plant:
    """The plant of a rig with its declared friction and no other mechanism."""
    coulomb = float(rig.get("coulomb_friction", 0.0))
    static = max(float(rig.get("static_friction", 0.0)), coulomb)
    link = Link(
        chain.lengths,
        np.ascontiguousarray(chain.inertia),
        chain.stiffness,
        np.ascontiguousarray(chain.damping),
        np.ascontiguousarray(chain.first_moment),
        1 / float(rig["bending_stiffness"]),
    )
    return Plant(link, Friction(static, static, coulomb, coulomb), hub_inertia=float(rig["hub_inertia"]))
