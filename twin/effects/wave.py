"""Effects that are periodic in the hub angle or in time, whose order or frequency is found from a spectrum."""

from dataclasses import dataclass
from typing import Literal

RESONANCE_DAMPING = 0.02
"""Damping ratio assumed in the spectral search for a resonance."""


@dataclass(frozen=True)
class Wave:
    """An effect amplitude * sin(order * variable + phase) of unknown order.

    At neutral, where the amplitude is 0, the derivative by the order is 0: no score test can find it.

    Attributes:
      acts: "torque" of the hub as a function of its angle, "friction" level as a function of the angle, torque of
        the hub as a function of "time", or error of the "reading" of the hub angle as a function of the angle;
        "resonance" is an oscillator excited by the acceleration of the hub.
      order: name of the parameter that is the order [per radian], or the frequency [Hz].
    """

    acts: Literal["torque", "friction", "time", "reading", "resonance"]
    order: str

    @property
    def by_angle(self) -> bool:
        """Whether it is periodic in the hub angle, not in time."""
        return self.acts in ("torque", "friction", "reading")
