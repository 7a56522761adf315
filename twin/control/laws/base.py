"""What a controller is, and the linear one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

if TYPE_CHECKING:
    import control


@runtime_checkable
class Controller(Protocol):
    """A discrete-time controller, called once a sample.

    It may have `states`, a mapping from name to the present value of what it remembers: a run records them.
    """

    def reset(self) -> None:
        """Forgets everything: the rig rests, and time begins."""

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque [N m] to command until the next sample.

        Args:
          measured: what the sensors read now, SI, by channel of the recording format: hub_angle,
            tip_deflection, strain_base, strain_mid, motor_torque; and `time` [s].
          reference: wanted hub angle [rad].
        """


class LinearController:
    """u = gain K(z) (reference - hub_angle), with K a discrete-time system.

    It commands what K asks for; the amplifier limits it. K must have no integrator if that limit is reached for
    long: nothing here stops one from winding up.
    """

    def __init__(self, system: control.StateSpace, gain: float = 1.0) -> None:
        """Takes a single-input single-output discrete-time system and the gain before it [1/rad]."""
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
