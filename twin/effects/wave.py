"""What repeats with the angle or with time, and how a search can look for its frequency."""

from dataclasses import dataclass
from typing import Literal

RESONANCE_DAMPING = 0.02
"""Damping ratio with which a resonance is looked for."""


@dataclass(frozen=True)
class Wave:
    """An effect amplitude * sin(order * variable + phase) of unknown order, which no slope at neutral can tell.

    Attributes:
      acts: as a "torque" of the hub angle, as a level of "friction" over it, as a "time" signal on the hub's
        torque, or on the "reading" of the hub angle; a "resonance" answers to the hub's acceleration.
      order: name of the parameter that is the order, or the frequency [Hz].
    """

    acts: Literal["torque", "friction", "time", "reading", "resonance"]
    order: str

    @property
    def by_angle(self) -> bool:
        """Whether it repeats with the angle of the hub."""
        return self.acts in ("torque", "friction", "reading")
