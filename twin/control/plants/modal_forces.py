"""Nonlinear forces on the modes: torques on the hub, and loads along the link.

Hub torques are those of the chain, `twin.mechanics.planar`. A load is a generalised force per coordinate (n). With
a_i(x) the slope of the link per coordinate, a = sum_i a_i q_i its angle, kappa its curvature, m(x) the mass outboard of
x, and v = sum_i tip_i q_i_t the velocity of the tip, the loads are

    gravity, base acceleration g   int m a_i (g_y cos a - g_x sin a) dx                of large angles, as in the chain
    softening of the link          int a_i' EI s kappa^3 / (kappa^2 + kappa_0^2) dx    s, kappa_0: see `plant.Link`
    quadratic drag of the tip      -drag_quadratic |v| v tip_i
"""

from __future__ import annotations

import numpy as np

from twin.control.plants.modal_rig import ModalRig
from twin.mechanics import planar
from twin.rigs.model import Model

_NODES = 12  # Gauss-Legendre nodes along the link
_SETTLE = 30  # fixed-point iterations for static equilibrium, as for the chain


class Forces:
    """Forces that are not linear in the state.

    Attributes:
      vary: whether any of them varies within a mode, that is while the hub rests or slides in one direction.
      loads: number of loads: n, or 0 without any.
    """

    def __init__(self, model: Model, rig: ModalRig) -> None:
        """Takes the model and its linear rig; hub torques that are linear enter by their constant only."""
        plant, linear = model.plant, [torque.linear for torque in model.hub_torques]
        others = np.array([part is None for part in linear], dtype=bool)
        self._plant = plant._replace(torques=plant.torques.select(others))
        self._pull = sum(part.constant for part in linear if part is not None)
        self._rig, self._hub, self._tip = rig, rig.hub, rig.tip
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        length = model.rig["length"]
        x, weights = 0.5 * length * (nodes + 1), 0.5 * length * weights
        self._slopes, self._curvatures = rig.link(x, 1), rig.link(x, 2)
        self._outboard = weights * (model.rig["linear_density"] * (length - x) + model.rig["tip_mass"])
        self._softened = weights * model.rig["bending_stiffness"] * plant.link.softening
        loaded = (
            plant.link.gravity_x or plant.link.gravity_y or plant.link.softening or plant.link.drag_quadratic
        )
        self.loads = len(rig.mass) if loaded or plant.link.is_shaken else 0
        friction = plant.friction.stribeck_velocity or plant.friction.amplitude
        self.vary = bool(self.loads or others.any() or friction)

    def static(self, q: np.ndarray, direction: int) -> float:
        """Static friction level in a direction at coordinates q (n) [N m]."""
        if self.vary:
            return planar.static_level(self._plant, float(self._hub @ q), direction)
        return self._plant.friction.static_positive if direction > 0 else self._plant.friction.static_negative

    def sliding(self, q: np.ndarray, direction: int) -> float:
        """Sliding friction level at zero rate in a direction at coordinates q (n) [N m]."""
        return planar.sliding_level(self._plant, float(self._hub @ q), 0.0, direction)

    def on_hub(self, time: float, q: np.ndarray, rates: np.ndarray, direction: int) -> float:
        """Returns the torque on a hub that slides in a direction (0: rests), friction included [N m]."""
        angle, rate = float(self._hub @ q), float(self._hub @ rates)
        torque = self._pull + planar.hub_torque(self._plant, time, angle, rate)
        if direction != 0:
            torque -= direction * planar.sliding_level(self._plant, angle, rate, direction)
        return torque

    def along_link(self, time: float, q: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Returns the loads (n) at a time [s], coordinates q and their rates (n)."""
        speed = float(self._tip @ rates)
        air = self._plant.link.drag_quadratic * abs(speed) * speed * self._tip
        return self._of_field(planar.acceleration_field(self._plant, time), q) + self._of_softening(q) - air

    def gravity_equilibrium(self, hub_angle: float) -> np.ndarray:
        """Returns coordinates (n) in static equilibrium with gravity, the hub held at an angle [rad]."""
        n, hub = len(self._hub), self._hub[:, None]
        held = np.block([[self._rig.stiffness, hub], [hub.T, np.zeros((1, 1))]])
        gravity = self._plant.link.gravity_x, self._plant.link.gravity_y
        q = np.zeros(n)
        q[0] = hub_angle
        if self.loads:
            for _ in range(_SETTLE):
                load = self._of_field(gravity, q)
                q = np.linalg.solve(held, np.append(load, hub_angle))[:n]
        return q

    def _of_field(self, field: tuple[float, float], q: np.ndarray) -> np.ndarray:
        """Loads (n) of an acceleration field along x and y [m/s^2]."""
        x, y = field
        angles = q @ self._slopes
        return self._slopes @ (self._outboard * (y * np.cos(angles) - x * np.sin(angles)))

    def _of_softening(self, q: np.ndarray) -> np.ndarray:
        """Loads (n) equivalent to the reduction of the bending moment by softening."""
        curvature = q @ self._curvatures
        square = curvature**2
        part = square / (square + self._plant.link.softening_curvature**2)
        return self._curvatures @ (self._softened * part * curvature)
