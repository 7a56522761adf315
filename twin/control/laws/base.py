"""The interface of a controller, and a linear controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

if TYPE_CHECKING:
    import control


@runtime_checkable
class Controller(Protocol):
    """A discrete-time controller, called once per sample.

    It may have an attribute `states`, a mapping from name to present value of its states, which a run records.
    """

    def reset(self) -> None:
        """Resets all states, for a rig at rest at time 0."""

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque command [N m] until the next sample.

        Args:
          measured: present sensor readings, SI, by channel of the recording format: hub_angle,
            tip_deflection, strain_base, strain_mid, motor_torque; and `time` [s].
          reference: reference of the hub angle [rad].
        """


class LinearController:
    """u = gain K(z) (reference - hub_angle), with K a discrete-time system.

    The command is not limited here, but by the amplifier. There is no anti-windup: K should have no integrator if the
    limit is reached for long.
    """

    def __init__(self, system: control.StateSpace, gain: float = 1.0) -> None:
        """Takes a discrete-time system K with one input and one output, and the gain before it [1/rad]."""
        self._A, self._B, self._C, self._D = (
            np.asarray(m, dtype=float) for m in (system.A, system.B, system.C, system.D)
        )
        self._gain = gain
        self.reset()

    @property
    def states(self) -> dict[str, float]:
        """State of K."""
        return {f"x{i + 1}": float(value) for i, value in enumerate(self._x)}

    def reset(self) -> None:
        """Puts the state of K to zero."""
        self._x = np.zeros(len(self._A))

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque [N m]; see `Controller`."""
        error = self._gain * (reference - measured["hub_angle"])
        u = float(self._C[0] @ self._x + self._D[0, 0] * error)
        self._x = self._A @ self._x + self._B[:, 0] * error
        return u
