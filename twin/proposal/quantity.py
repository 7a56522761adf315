"""Numbers as people write them: with a unit and an uncertainty, "345 mm ± 0.5 %"."""

from __future__ import annotations

import re
from typing import NamedTuple

from twin.campaigns import units
from twin.errors import InputError, shown

_NUMBER = r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?"
_QUANTITY = re.compile(
    rf"(?P<value>{_NUMBER})(?:\s+(?P<unit>[^±]*?)|(?P<close>[^\d\s±+.,-][^±]*?))?"
    rf"(?:\s*(?:±|\+/?-)\s*(?P<error>{_NUMBER})\s*(?P<of>\S.*)?)?"
)


class Quantity(NamedTuple):
    """A number with what stands behind it.

    Attributes:
      value: in `unit`.
      unit: as written; "" where there is none.
      uncertainty: relative standard deviation [1]; None where there is none.
    """

    value: float
    unit: str
    uncertainty: float | None

    def to(self, unit: str) -> float:
        """Returns the value in another unit, which is that of the number where it has none.

        Raises:
          InputError: the two units measure different quantities, or one is no unit.
        """
        return self.value * (units.factor(self.unit, unit) if self.unit else 1.0)


def quantity(text: str) -> Quantity:
    """Reads a number with unit and uncertainty, either of which may be missing; an uncertainty in % or in the unit.

    Raises:
      InputError: it is none.
    """
    found = _QUANTITY.fullmatch(text.strip())
    if found is None:
        raise InputError(f"'{shown(text.strip())}' is no number")
    value, unit = _float(found["value"]), (found["unit"] or found["close"] or "").strip(" ,;")
    if found["error"] is None:
        return Quantity(value, unit, None)
    error, of = abs(_float(found["error"])), (found["of"] or "").strip()
    if of == "%":
        return Quantity(value, unit, error / 100)
    if of and unit and of != unit:
        error *= units.factor(of, unit)
    return Quantity(value, unit or of, error / abs(value) if value else None)


def _float(text: str) -> float:
    return float(text.replace(",", "."))
