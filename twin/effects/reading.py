"""What a sensor reports of a true value, in terms that MJCF has elements for."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Reading:
    """r + rate t + offset + amplitude sin(order r + phase), all of it `delay` late.

    Attributes:
      gain, twist: r = gain * truth + twist * angle of a torsional mode [rad].
      rate: [1/s].
      offset: in the unit of the channel.
      amplitude, order, phase: of a wave over r.
      delay: [s].
    """

    gain: float = 1.0
    rate: float = 0.0
    offset: float = 0.0
    amplitude: float = 0.0
    order: float = 1.0
    phase: float = 0.0
    twist: float = 0.0
    delay: float = 0.0

    @property
    def is_sum(self) -> bool:
        """Whether there is more to it than r."""
        return self.rate != 0 or self.amplitude != 0

    def scaled(self, factor: float) -> Reading:
        """The reading times a factor."""
        scaled = {
            name: factor * getattr(self, name) for name in ("gain", "rate", "offset", "amplitude", "twist")
        }
        return replace(self, **scaled, order=self.order / factor)
