"""Physical parameters of a rig, with unit, uncertainty, bounds and source, and those of the recording format."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from twin.errors import InputError, checked_number, nearest


@dataclass(frozen=True)
class Parameter:
    """One physical parameter.

    Attributes:
      name: name in the recording format, say `bending_stiffness`.
      value: value in `unit`.
      unit: SI unit.
      uncertainty: relative standard deviation of the value [1]; None where not declared.
      bounds: smallest and largest possible value, in `unit`; those of `PARAMETERS` hold beside them.
      source: origin of the value: table, page, equation, "assumed".

    Raises:
      InputError: the value is outside its bounds, or the uncertainty negative.
    """

    name: str
    value: float
    unit: str
    uncertainty: float | None = None
    bounds: tuple[float, float] = (-math.inf, math.inf)
    source: str = "assumed"

    def __post_init__(self) -> None:
        _, known = PARAMETERS.get(self.name, (self.unit, self.bounds))
        low, high = max(self.bounds[0], known[0]), min(self.bounds[1], known[1])
        checked_number(self.name, self.value, low, high, self.unit)
        if self.uncertainty is not None:
            checked_number(f"uncertainty of {self.name}", self.uncertainty, 0.0, math.inf)


@dataclass(frozen=True)
class Rig(Mapping[str, float]):
    """The declared parameters of a rig; immutable.

    A mapping from parameter name to value (SI), as in `rig["length"]`; `rig.parameters` has each `Parameter`.
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
        """Returns a rig with other values of some parameters; their unit, bounds and uncertainty are kept.

        Raises:
          InputError: the rig has no such parameter, or none can have this value.
        """
        for name in values:
            if name not in self.parameters:
                raise InputError(
                    f"'{name}' is not a parameter of {self.name}{nearest(name, self.parameters)}"
                )
        changed = {n: replace(self.parameters[n], value=v, source=source) for n, v in values.items()}
        return replace(self, parameters={**self.parameters, **changed})

    def __reduce__(self):
        return (type(self), (self.name, dict(self.parameters)))


# Relative standard deviations [1] where a campaign declares none: assumed, as a careful laboratory would state them.
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
    """Returns the relative standard deviation of a parameter [1], declared or assumed; 0 where it counts as exact."""
    if parameter.uncertainty is None:
        return ASSUMED_UNCERTAINTY.get(parameter.name, 0.0)
    return parameter.uncertainty


def declared_range(parameter: Parameter, deviations: float) -> tuple[float, float]:
    """Returns the range of a parameter within so many standard deviations, within its bounds.

    It is [value / f, value * f] with f = exp(deviations * relative uncertainty): the range of a log-normal quantity,
    which is positive however large its uncertainty is.
    """
    factor = math.exp(deviations * relative_uncertainty(parameter))
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
"""Parameter of the recording format -> SI unit, and smallest and largest value that a rig can have."""


def rig_parameter(name: str, value: float, uncertainty: float | None, source: str) -> Parameter:
    """Returns a parameter of the recording format, in its unit and within its bounds.

    Raises:
      InputError: no rig can have this value, or the uncertainty is negative.
    """
    unit, bounds = PARAMETERS[name]
    return Parameter(name, value, unit, uncertainty, bounds, source)


DEFAULTS: Mapping[str, float] = {
    "tip_mass": 0.0,
    "tip_inertia": 0.0,
    "damping_ratio": 0.01,
    "static_friction": 0.0,
    "coulomb_friction": 0.0,
    "torque_limit": math.inf,
}
"""Values of parameters that a rig without a preset need not declare; all others are then required."""
