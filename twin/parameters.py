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


# Standard deviations assumed where a campaign leaves them unsaid, as a careful lab would state them.
ASSUMED_UNCERTAINTY = {
    "bending_stiffness": 0.02,
    "linear_density": 0.01,
    "length": 0.002,
    "hub_inertia": 0.03,
    "tip_mass": 0.01,
    "tip_inertia": 0.05,
    "damping_ratio": 0.1,
    "static_friction": 0.1,
    "coulomb_friction": 0.1,
}


def relative_uncertainty(parameter: Parameter) -> float:
    """Relative standard deviation of a declared parameter [1], as said or as a careful lab would say; 0 where exact."""
    if parameter.uncertainty is None:
        return ASSUMED_UNCERTAINTY.get(parameter.name, 0.0)
    return parameter.uncertainty


def declared_range(parameter: Parameter, deviations: float) -> tuple[float, float]:
    """Values so many deviations about a declared one; a rough one may be off by a factor, and stays positive."""
    factor = 1 + deviations * relative_uncertainty(parameter)
    low, high = parameter.bounds
    return max(parameter.value / factor, low), min(parameter.value * factor, high)


PARAMETERS: Mapping[str, tuple[str, tuple[float, float]]] = {
    "bending_stiffness": ("N*m^2", (1e-6, 1e6)),
    "linear_density": ("kg/m", (1e-6, 1e3)),
    "length": ("m", (1e-3, 1e2)),
    "hub_inertia": ("kg*m^2", (1e-9, 1e3)),
    "tip_mass": ("kg", (0.0, 1e3)),
    "tip_inertia": ("kg*m^2", (0.0, 1e3)),
    "damping_ratio": ("1", (0.0, 0.5)),
    "static_friction": ("N*m", (0.0, 1e3)),
    "coulomb_friction": ("N*m", (0.0, 1e3)),
    "torque_limit": ("N*m", (1e-9, math.inf)),
}
"""Every parameter of the format with its SI unit and what is physically possible."""
DEFAULTS: Mapping[str, float] = {
    "tip_mass": 0.0,
    "tip_inertia": 0.0,
    "damping_ratio": 0.01,
    "static_friction": 0.0,
    "coulomb_friction": 0.0,
    "torque_limit": math.inf,
}
"""What holds for a rig that no preset describes; the other parameters are then required."""
