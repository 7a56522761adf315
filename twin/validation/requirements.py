"""Requirements on a controller: limits on performance metrics and stability margins.

The defaults are assumed: no source states requirements for this rig. They demand a slew that settles within a second of
the paper's (Bossi et al. 2009, Fig. 9), a torque that the motor can give, deflections for which the beam is linear, and
textbook values of the margins.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from twin.errors import LARGEST, InputError, checked_number, nearest, quoted
from twin.files.toml import read_toml


@dataclass(frozen=True)
class Requirement:
    """A limit on one metric.

    Attributes:
      name: of the metric, its key in files.
      description: what it measures.
      unit: of metric and limit.
      limit: the limit.
      at_least: whether the limit is a lower one; otherwise it is an upper one.
      least: smallest value that the metric can have.
    """

    name: str
    description: str
    unit: str
    limit: float
    at_least: bool = False
    least: float = 0.0

    def met(self, value: float) -> bool:
        """Whether a value of the metric meets the limit; NaN does not."""
        return value >= self.limit if self.at_least else value <= self.limit

    def badness(self, value: float) -> float:
        """The value with the sign by which larger is worse."""
        return -value if self.at_least else value


DEFAULTS = (
    Requirement("overshoot", "overshoot of the hub, of the step", "%", 5.0),
    Requirement("settling_time", "time until the hub stays within 2 % of the step", "s", 3.0),
    Requirement("steady_state_error", "mean error of the hub in the last second, of the step", "%", 2.0),
    Requirement("residual_vibration", "tip in the last second, peak to peak, of the length", "%", 5.0),
    Requirement("peak_deflection", "largest deflection of the tip, of the length", "%", 25.0),
    Requirement("peak_torque", "largest torque of the motor", "N*m", 0.3),
    Requirement("saturated_share", "share of the time at the amplifier's limit", "%", 25.0),
    Requirement(
        "growth_rate", "growth rate of the linear loop, negative if stable", "1/s", 0.0, least=-LARGEST
    ),
    Requirement("gain_margin", "gain margin of the linear loop", "dB", 6.0, at_least=True, least=-LARGEST),
    Requirement(
        "phase_margin", "phase margin of the linear loop", "deg", 30.0, at_least=True, least=-LARGEST
    ),
    Requirement("disk_margin", "disk margin of the linear loop", "1", 0.4, at_least=True),
)

LINEAR_METRICS = ("growth_rate", "gain_margin", "phase_margin", "disk_margin")
"""Metrics that need a linear form of the controller."""

_LEAST_SHARE = 1e-6
"""Least share of the rigs that can be demanded [1]: no fleet is large enough to tell less from none."""
SETTLING_BAND = 0.02
"""Half width of the band in which the hub has settled, over the step [1]."""


@dataclass(frozen=True)
class Requirements:
    """Limits, and the share of the rigs that have to keep all of them.

    Attributes:
      limits: name of a metric -> requirement.
      share: of the drawn rigs [1].
    """

    limits: Mapping[str, Requirement]
    share: float = 0.95


def defaults() -> Requirements:
    """Returns the default requirements."""
    return Requirements(MappingProxyType({r.name: r for r in DEFAULTS}))


def read_requirements(path: Path) -> Requirements:
    """Reads limits from a TOML file: `metric = limit`, `metric = false` for none, and `share`; the rest is default.

    Raises:
      InputError: the file cannot be used; the message names file and key.
    """
    content = read_toml(path, "requirements")
    known = defaults()
    limits, share = dict(known.limits), known.share
    for key, value in content.items():
        if key == "share":
            share = checked_number(f"{path.name}: share", value, _LEAST_SHARE, 1.0)
        elif key not in limits:
            expected = ("share", *known.limits)
            raise InputError(
                f"{path.name}: {quoted(key)} is not a requirement; expected one of: {', '.join(expected)}"
                f"{nearest(key, expected)}"
            )
        elif value is False:
            del limits[key]
        else:
            limits[key] = replace(limits[key], limit=_limit(f"{path.name}: {key}", value, limits[key]))
    if not limits:
        raise InputError(f"{path.name}: no requirement is left; expected at least one")
    return Requirements(MappingProxyType(limits), share)


def _limit(field: str, value: Any, known: Requirement) -> float:
    """A limit that the metric can reach; raises InputError where it is none."""
    try:
        return checked_number(field, value, known.least, unit=known.unit)
    except InputError as error:
        raise InputError(f"{error}, or false for no limit") from None
