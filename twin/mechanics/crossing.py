"""Locates the instant at which a simulation that can be repeated crosses zero."""

from __future__ import annotations

from collections.abc import Callable

from twin.mechanics.planar import EVENT_TOLERANCE


def locate_zero(
    value: Callable[[float], float], restore: Callable[[], None], high: float, at_low: float, at_high: float
) -> float:
    """Returns a point between 0 and `high` at which `value` has just become negative, within EVENT_TOLERANCE.

    Illinois algorithm: regula falsi with one end's value halved when the other moves twice (M. Dowell, P. Jarratt,
    BIT 11, 1971). `restore` is called before each call of `value`, the last of which is at the returned point and
    leaves the state there. The point is never 0, so that time advances.
    """
    low, moved, last = 0.0, 0, high
    at_low = max(at_low, 0.0)
    while high - low > EVENT_TOLERANCE:
        middle = high - at_high * (high - low) / (at_high - at_low)
        # Keep off the ends, so that the bracket shrinks from both sides.
        last = middle = min(max(middle, low + EVENT_TOLERANCE / 2), high - EVENT_TOLERANCE / 2)
        restore()
        at_middle = value(middle)
        if at_middle < 0:
            high, at_high = middle, at_middle
            at_low, moved = (at_low / 2 if moved == -1 else at_low), -1
        else:
            low, at_low = middle, at_middle
            at_high, moved = (at_high / 2 if moved == 1 else at_high), 1
    if last != high:
        restore()
        value(high)
    return high
