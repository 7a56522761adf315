"""A spring between the simulated hub and the measured one, by which a simulation observes a recording.

The torque stiffness (theta_measured(t) - theta) on the hub is zero where the model is right, whatever its stiffness.
Where it is not, the error of the hub is bounded instead of growing to the end of the recording, and the residual is a
smooth function of the parameters where that of a free run jumps with every stick. Fits begin with a stiff spring and
end with a soft one: the homotopy method (C. P. Vyasarayani, T. Uchida, A. Carvalho and J. McPhee, Parameter
identification in dynamic systems using the homotopy optimization approach, Multibody System Dynamics 26, 2011,
411-424).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.mechanics.hub_law import HubLaw
from twin.mechanics.plant import Plant


@dataclass(frozen=True, eq=False)
class HubSpring:
    """A spring to the measured hub angle.

    Attributes:
      stiffness: [N m/rad].
      period: between measured angles [s].
      angle: (m) measured, from the first sample of the recording on [rad].
    """

    stiffness: float
    period: float
    angle: np.ndarray

    def on(self, plant: Plant) -> Plant:
        """Returns the plant with the torque of the spring on its hub."""
        torques = plant.torques
        values = np.r_[self.stiffness, self.period, len(self.angle), self.angle]
        return plant._replace(
            torques=torques._replace(
                addresses=np.r_[torques.addresses, _pull.address],
                first=np.r_[torques.first, len(torques.values)],
                values=np.r_[torques.values, values],
                on_motor=np.r_[torques.on_motor, False],
            )
        )


def stiffness_for(plant: Plant, period: float) -> float:
    """Stiffness [N m/rad] with which the unbent rig, motor included, oscillates in a period [s], maybe infinite."""
    inertia = float(plant.link.inertia.sum())
    return inertia * (2 * np.pi / period) ** 2


@HubLaw
def _pull(t, theta, omega, values):
    """Torque of the spring [N m]; values: stiffness, period, number m of measured angles, and these."""
    last = int(values[2]) - 1
    place = min(max(t / values[1], 0.0), float(last))
    k = min(int(place), last - 1)
    measured = values[3 + k] + (place - k) * (values[4 + k] - values[3 + k])
    return values[0] * (measured - theta)
