"""A spring with a damper between the simulated hub and the measured one: a simulation that observes a recording.

Their torque is zero where the model is right. Where it is not, the error of the hub is bounded instead of growing to
the end of the recording, and the residual is a smooth function of the parameters where that of a free run jumps with
every stick. Fits begin with a stiff spring and
end with a soft one: the homotopy method (C. P. Vyasarayani, T. Uchida, A. Carvalho and J. McPhee, Parameter
identification in dynamic systems using the homotopy optimization approach, Multibody System Dynamics 26, 2011,
411-424).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.mechanics.hub_law import HubLaw
from twin.mechanics.plant import Plant


@dataclass(frozen=True)
class Spring:
    """Stiffness [N m/rad] and damping [N m s/rad] of a spring between the simulated hub and the measured one."""

    stiffness: float
    damping: float

    def on(self, plant: Plant, hub: MeasuredHub) -> Plant:
        """Returns the plant with the torque of the spring to a measured hub."""
        torques = plant.torques
        values = np.r_[
            self.stiffness, self.damping, hub.since, hub.period, len(hub.angle), hub.angle, hub.rate
        ]
        return plant._replace(
            torques=torques._replace(
                addresses=np.r_[torques.addresses, _pull.address],
                first=np.r_[torques.first, len(torques.values)],
                values=np.r_[torques.values, values],
                on_motor=np.r_[torques.on_motor, False],
            )
        )


@dataclass(frozen=True, eq=False)
class MeasuredHub:
    """Measured motion of a hub, to which a spring pulls; m instants.

    Attributes:
      since: time from the first sample from which on the spring acts [s].
      period: between instants, from the first sample of the recording on [s].
      angle, rate: (m) [rad], [rad/s].
    """

    since: float
    period: float
    angle: np.ndarray
    rate: np.ndarray


def spring_of(plant: Plant, period: float, damping_ratio: float) -> Spring:
    """Returns the spring on which the unbent rig, motor included, oscillates in a period.

    Args:
      plant: of the rig.
      period: [s]; without a spring infinite.
      damping_ratio: of the oscillation by the damper alone [1].
    """
    inertia, frequency = float(plant.link.inertia.sum()), 2 * np.pi / period
    return Spring(inertia * frequency**2, 2 * damping_ratio * inertia * frequency)


@HubLaw
def _pull(t, theta, omega, values):
    """Torque of the spring [N m]; values as packed by `Spring.on`."""
    if t < values[2]:
        return 0.0
    count = int(values[4])
    place = min(t / values[3], float(count - 1))
    k = min(int(place), count - 2)
    share = place - k
    angle = values[5 + k] + share * (values[6 + k] - values[5 + k])
    rate = values[5 + count + k] + share * (values[6 + count + k] - values[5 + count + k])
    return values[0] * (angle - theta) + values[1] * (rate - omega)
