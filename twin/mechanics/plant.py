"""All numbers of the chain's equations of motion, as one value: link, friction, motor, torques on the hub.

How to read them, with the equations of `twin.mechanics.planar`. The coordinates phi are absolute angles [rad]: phi_0 of
segment 0, which is rigidly part of the hub, then those of the n other segments. With i, j = 0..n,

    sum_j c_ij cos(phi_i - phi_j) phi_j'' = - sum_j c_ij sin(phi_i - phi_j) phi_j'^2 + Q_i

    c_ij                 `Link.inertia`
    Q_i, hinge moments   M_k = stiffness_k (phi_k - phi_(k-1)) + sum_j damping_kj (phi_j' - phi_(j-1)'), k = 1..n:
                         -M_k on segment k, +M_k on segment k - 1
    Q_i, gravity         first_moment_i (gravity_y cos phi_i - gravity_x sin phi_i), less those of `shake_x`, `shake_y`
    Q_i, drag            -(drag_linear + drag_quadratic |v|) v on the tip, v its velocity
    Q_0, hub only        motor torque (`Motor`), dry friction (`Friction`), other torques (`Torques`)

Each mechanism that an effect may add is a field whose default switches it off: an equation holds without the term.

Some effects append coordinates after those of the segments, first the absolute angle of an oscillator on the hub (a
torsional mode), then that of a motor separated from the hub by backlash. Arrays of size n + 1 then have size n + 1 + k,
with length 0 and no first moment for each of the k appended coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from twin.mechanics.chain import Chain
from twin.mechanics.hub_law import NO_TORQUES, Torques

IMMOVABLE = 1e9
"""Static friction level of a hub that no torque can move from rest [N m]."""

CONTACT_STIFFNESS = 100.0
"""Contact stiffness of the flanks of a backlash [N m/rad] unless it is fitted: 0.2 N m compress them by 0.1 degrees."""
CONTACT_DAMPING = 0.3
"""Damping ratio of the motor on a flank of a held hub [1] unless it is fitted: a rebound with 0.45 of the speed.

Where fits of it begin."""
CONTACT_STEP = 1e-4
"""Largest step of an integration that does not locate impacts [s]: an impact takes about 2 ms."""
CONTACT_PHASE = 0.5
"""Step on a flank of the backlash times the frequency of the contact, or the rate at which its damper slows it [1]: the
error of a Runge-Kutta step is 3e-4."""


class Link(NamedTuple):
    """Link, payload and the oscillator on the hub, SI units; n hinges, k appended coordinates (see the module).

    These numbers alone determine how the link moves under a given motion of the hub. Defaults switch a mechanism off.
    """

    lengths: np.ndarray  # (n + 1 + k) m, of the segments
    inertia: np.ndarray  # (n + 1 + k, n + 1 + k) kg m^2, c_ij; hub, motor and payload included
    stiffness: np.ndarray  # (n) N m/rad, of the hinges
    damping: np.ndarray  # (n, n) N m s/rad, hinge moments per hinge rate
    first_moment: np.ndarray  # (n + 1 + k) kg m, mass times lever, summed over all that segment i carries
    flexibility: float  # 1/(N m^2), 1/EI: curvature of the link per bending moment
    drag_linear: float = 0.0  # N s/m, force on the tip against its velocity v: drag_linear v
    drag_quadratic: float = 0.0  # N s^2/m^2, and drag_quadratic |v| v
    softening: float = 0.0  # s [1]: stiffness of a hinge is k (1 - s kappa^2/(kappa^2 + kappa_0^2))
    softening_curvature: float = 1.0  # 1/m, kappa_0
    gravity_x: float = 0.0  # m/s^2, component in the plane of motion
    gravity_y: float = 0.0  # m/s^2
    shake_x: float = 0.0  # m/s^2, amplitude of a sinusoidal acceleration of the base
    shake_y: float = 0.0  # m/s^2
    shake_frequency: float = 1.0  # Hz
    shake_phase: float = 0.0  # rad
    torsion_stiffness: float = 0.0  # N m/rad, between the hub and an oscillator on it
    torsion_damping: float = 0.0  # N m s/rad

    @property
    def is_shaken(self) -> bool:
        """Whether the base is accelerated."""
        return self.shake_x != 0 or self.shake_y != 0

    @property
    def curvature_per_angle(self) -> np.ndarray:
        """Curvature of the link per hinge angle (n) [1/m per rad]; 0 for a compliant clamp's hinge on the hub axis."""
        return np.where(self.lengths[: len(self.stiffness)] > 0, self.flexibility * self.stiffness, 0.0)

    def secant_stiffness(self, angles: np.ndarray) -> np.ndarray:
        """Elastic moment over angle of the hinges (n) [N m/rad] at hinge angles (n) [rad], with softening."""
        return self.stiffness * (1 - self.softened_share(self.curvature_per_angle * angles))

    def softened_share(self, curvature: np.ndarray) -> np.ndarray:
        """Share of the stiffness that the hinges (n) lack at curvatures (n) [1/m]: s kappa^2/(kappa^2 + kappa_0^2)."""
        squared = curvature**2
        return self.softening * squared / (squared + self.softening_curvature**2)

    @property
    def mechanisms(self) -> dict[str, float]:
        """Scalar fields of the forces on the link that depend on its state: drag, softening, gravity, torsion."""
        own = ("flexibility", "shake_x", "shake_y", "shake_frequency", "shake_phase")
        return {n: v for n, v in self._asdict().items() if n not in own and not isinstance(v, np.ndarray)}


class Friction(NamedTuple):
    """Dry friction: static (break-away) and Coulomb level of each direction [N m], and their variation.

    It acts on the hub, or, if `on_motor` and there is a backlash, on the motor. At the angle theta and rate omega of
    the one it acts on, both levels are raised by amplitude (1 + sin(order theta + phase))/2. The sliding level is
    coulomb + (static - coulomb) exp(-(omega/stribeck_velocity)^2), and coulomb where that velocity is 0.
    """

    static_positive: float = 0.0
    static_negative: float = 0.0
    coulomb_positive: float = 0.0
    coulomb_negative: float = 0.0
    stribeck_velocity: float = 0.0  # rad/s
    amplitude: float = 0.0  # N m
    order: float = 1.0  # periods per turn of the hub
    phase: float = 0.0  # rad
    on_motor: bool = False

    def levels(self, direction: float) -> tuple[float, float]:
        """Static and Coulomb level in a direction, +1 or -1, without the variation with angle [N m]."""
        if direction > 0:
            return self.static_positive, self.coulomb_positive
        return self.static_negative, self.coulomb_negative

    def scaled(self, share: float) -> Friction:
        """Returns friction with its static levels multiplied by `share`, but not below the Coulomb levels.

        A hub that broke away below the Coulomb level would stop and break away again without end.
        """
        return self._replace(
            static_positive=max(share * self.static_positive, self.coulomb_positive),
            static_negative=max(share * self.static_negative, self.coulomb_negative),
        )


class Motor(NamedTuple):
    """The motor: first-order lag of its torque, and backlash between it and the hub; defaults are neither."""

    lag: float = 0.0  # s, time constant of the torque behind its command
    gap: float = 0.0  # rad, whole backlash between motor and hub
    inertia: float = 0.0  # kg m^2, of a motor with backlash; included in `Link.inertia`
    contact_stiffness: float = CONTACT_STIFFNESS  # N m/rad, of the flanks
    contact_damping: float = 0.0  # N m s/rad, of the flanks
    contact_step: float = np.inf  # s, largest integration step while the motor is on a flank


class Plant(NamedTuple):
    """All numbers of the equations of motion, SI units.

    Attributes:
      link: link and payload.
      friction: dry friction of the hub.
      motor: lag and backlash.
      torques: on the hub, other than motor torque and dry friction.
      hub_inertia: as declared [kg m^2]; included in `link.inertia`.
    """

    link: Link
    friction: Friction = Friction()
    motor: Motor = Motor()
    torques: Torques = NO_TORQUES
    hub_inertia: float = 0.0

    def with_link(self, **changes: Any) -> Plant:
        """Returns a plant with some fields of its link changed."""
        return self._replace(link=self.link._replace(**changes))

    def with_friction(self, **changes: Any) -> Plant:
        """Returns a plant with some fields of its friction changed."""
        return self._replace(friction=self.friction._replace(**changes))

    def with_motor(self, **changes: float) -> Plant:
        """Returns a plant with some fields of its motor changed."""
        return self._replace(motor=self.motor._replace(**changes))

    def with_torsion(self, inertia: float, stiffness: float, damping: float) -> Plant:
        """Returns a plant with an oscillator on the hub.

        Args:
          inertia: of the oscillator, subtracted from that of the hub [kg m^2].
          stiffness, damping: between hub and oscillator [N m/rad], [N m s/rad].
        """
        # The motor's coordinate stays the last one.
        place = len(self.link.lengths) - (1 if self.motor.gap > 0 else 0)
        added = self._with_extra(inertia, place)
        return added.with_link(torsion_stiffness=stiffness, torsion_damping=damping)._with_contact_step()

    def with_backlash(
        self,
        gap: float,
        motor_inertia: float,
        stiffness: float = CONTACT_STIFFNESS,
        damping_ratio: float = CONTACT_DAMPING,
        friction_on_motor: bool = False,
    ) -> Plant:
        """Returns a plant with backlash between motor and hub.

        Args:
          gap: whole backlash [rad].
          motor_inertia: the motor's share of the hub's inertia [kg m^2].
          stiffness: of the flanks [N m/rad].
          damping_ratio: of the motor on a flank of a held hub [1].
          friction_on_motor: whether dry friction acts on the motor, not on the hub.
        """
        behind = self._with_extra(motor_inertia, len(self.link.lengths)).with_friction(
            on_motor=friction_on_motor
        )
        damping = 2 * damping_ratio * math.sqrt(stiffness * motor_inertia)
        motor = {
            "gap": gap,
            "inertia": motor_inertia,
            "contact_stiffness": stiffness,
            "contact_damping": damping,
        }
        return behind.with_motor(**motor)._with_contact_step()

    def without_motor(self) -> Plant:
        """Returns the hub side of the backlash: the plant without motor coordinate; itself where it has no backlash."""
        if self.motor.gap <= 0:
            return self
        behind = self.with_link(
            lengths=self.link.lengths[:-1],
            inertia=np.ascontiguousarray(self.link.inertia[:-1, :-1]),
            first_moment=self.link.first_moment[:-1],
        )
        return behind.with_motor(gap=0.0)._replace(torques=self.torques.select(~self.torques.on_motor))

    def with_backlash_closed(self) -> Plant:
        """Returns a plant whose motor stays in contact, rigidly part of the hub; itself where it has no backlash."""
        if self.motor.gap <= 0:
            return self
        behind = self.without_motor()
        inertia = behind.link.inertia.copy()
        inertia[0, 0] += self.motor.inertia
        return behind.with_link(inertia=inertia).with_motor(inertia=0.0)._replace(torques=self.torques)

    @property
    def rubs_on_motor(self) -> bool:
        """Whether dry friction acts on a motor behind a backlash, and none on the hub."""
        return self.friction.on_motor and self.motor.gap > 0

    @property
    def largest_step(self) -> float:
        """Largest integration step that the appended coordinates allow where impacts are not located [s]."""
        return CONTACT_STEP if self.motor.gap > 0 else np.inf

    def extend_state(self, state: np.ndarray) -> np.ndarray:
        """Returns angles or rates (n + 1 + k) from those of the segments (n + 1): appended ones equal the hub's."""
        return np.r_[state, np.full(len(self.link.lengths) - len(state), state[0])]

    def on_flank(self, phi: np.ndarray, torque: float) -> np.ndarray:
        """Returns angles (n + 1 + k) with the motor on the flank on which a torque [N m] presses it, if any."""
        if self.motor.gap <= 0:
            return phi
        return np.r_[phi[:-1], phi[-1] + np.sign(torque) * self.motor.gap / 2]

    def _with_contact_step(self) -> Plant:
        """Returns the plant with the step on a flank that its inertias allow; itself where it has no backlash."""
        if self.motor.gap <= 0:
            return self
        hub_mobility = float(np.linalg.inv(self.link.inertia[:-1, :-1])[0, 0])
        # A fit may try shares of inertia that leave the hub less than none; its simulation then diverges.
        mobility = 1 / self.motor.inertia + abs(hub_mobility)
        fastest = max(
            math.sqrt(self.motor.contact_stiffness * mobility), self.motor.contact_damping * mobility
        )
        return self.with_motor(contact_step=CONTACT_PHASE / fastest)

    def _with_extra(self, inertia: float, place: int) -> Plant:
        """Returns a plant with a coordinate inserted at `place`, its inertia [kg m^2] subtracted from the hub's."""
        matrix = np.insert(np.insert(self.link.inertia, place, 0.0, axis=0), place, 0.0, axis=1)
        matrix[0, 0] -= inertia
        matrix[place, place] = inertia
        return self.with_link(
            lengths=np.insert(self.link.lengths, place, 0.0),
            inertia=np.ascontiguousarray(matrix),
            first_moment=np.insert(self.link.first_moment, place, 0.0),
        )


def declared_plant(rig: Mapping[str, float], chain: Chain) -> Plant:
    """Returns the plant of a rig with its declared friction and no other mechanism."""
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
