"""The reading of a sensor as a function of the true value, in terms that MJCF has elements for."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Reading:
    """Reading r + rate t + offset + amplitude sin(order r + phase), delayed by `delay`.

    Attributes:
      gain, twist: r = gain * true value + twist * angle of a torsional mode [rad].
      rate: drift, in the unit of the channel per second.
      offset: in the unit of the channel.
      amplitude, order, phase: of a periodic error; the amplitude in the unit of the channel.
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
        """Whether drift or periodic error are added to r."""
        return self.rate != 0 or self.amplitude != 0

    def scaled(self, factor: float) -> Reading:
        """The reading multiplied by a factor."""
        scaled = {
            name: factor * getattr(self, name) for name in ("gain", "rate", "offset", "amplitude", "twist")
        }
        return replace(self, **scaled, order=self.order / factor)
