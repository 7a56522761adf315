"""Numbers that never travel alone: value, unit, uncertainty, bounds, source."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from twin.errors import nearest


@dataclass(frozen=True)
class Parameter:
    """One physical parameter.

    Attributes:
      name: name in the recording format, say `bending_stiffness`.
      value: value in `unit`.
      unit: SI unit.
      uncertainty: relative standard deviation of the value [1]; None where nothing is said of it.
      bounds: smallest and largest value that is physically possible, in `unit`.
      source: where the value comes from: table, page, equation, "assumed".
    """

    name: str
    value: float
    unit: str
    uncertainty: float | None = None
    bounds: tuple[float, float] = (-math.inf, math.inf)
    source: str = "assumed"

    def __post_init__(self) -> None:
        low, high = self.bounds
        if not low <= self.value <= high:
            raise ValueError(f"{self.name} is {self.value:g} {self.unit}; expected {low:g} to {high:g}")
        if self.uncertainty is not None and not self.uncertainty >= 0:
            raise ValueError(f"uncertainty of {self.name} is {self.uncertainty}; expected a number >= 0")


@dataclass(frozen=True)
class Rig(Mapping[str, float]):
    """The declared parameters of a rig, read as `rig["length"]`; immutable.

    A mapping from parameter name to value (SI); `rig.parameters` has the whole `Parameter`.
    """

    name: str
    parameters: Mapping[str, Parameter] = field(repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    def __getitem__(self, name: str) -> float:
        if name not in self.parameters:
            raise KeyError(f"'{name}' is not a parameter of {self.name}{nearest(name, self.parameters)}")
        return self.parameters[name].value

    def __iter__(self) -> Iterator[str]:
        return iter(self.parameters)

    def __len__(self) -> int:
        return len(self.parameters)

    def replace(self, source: str = "set by the caller", **values: float) -> Rig:
        """Returns a rig with other values of some parameters; unit, bounds and uncertainty stay."""
        changed = {n: replace(self.parameters[n], value=v, source=source) for n, v in values.items()}
        return replace(self, parameters={**self.parameters, **changed})

    def __reduce__(self):
        return (type(self), (self.name, dict(self.parameters)))
