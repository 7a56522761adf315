"""What a simulation needs of a rig as a whole, beyond the bounds of each parameter."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from twin.errors import InputError
from twin.parameters import PARAMETERS
from twin.recording import Sensor

_SHORTEST_STEP = 1e-6
"""Shortest integration step [s]: with it, 5 s of an experiment take MuJoCo more than a minute."""
_FASTEST = 400.0
"""Fastest eigenvalue of a chain of 8 segments over sqrt(EI / (rho l^4)) [1]: 393 for `bossi2009`."""
_STABLE = 2.6
"""Radius of the stability region of the Runge-Kutta method [1], see `Chain.largest_step`."""


_SHORTENED = 0.01
"""Share by which a fit may have shortened a link [1], five times what a ruler leaves open: a gauge at its end stays."""


def check_parameters(rig: Mapping[str, float]) -> None:
    """Makes sure that a rig has every parameter, and a link that is slow enough to be simulated.

    Raises:
      InputError: it has not.
    """
    lacking = [name for name in PARAMETERS if name not in rig]
    if lacking:
        raise InputError(f"the rig has no {', '.join(lacking)}; expected a value for each")
    length = rig["length"]
    fastest = _FASTEST * math.sqrt(rig["bending_stiffness"] / rig["linear_density"]) / length**2
    if fastest * _SHORTEST_STEP > _STABLE:
        raise InputError(
            f"a link of {length:g} m with {rig['linear_density']:g} kg/m and {rig['bending_stiffness']:g} N*m^2 "
            f"vibrates too fast: its simulation takes steps of {_STABLE / fastest:.1g} s; expected at least "
            f"{_SHORTEST_STEP:g} s: check length, linear_density and bending_stiffness"
        )


def check_gauges(rig: Mapping[str, float], sensors: Iterable[Sensor]) -> None:
    """Makes sure that every strain gauge is on the link.

    Raises:
      InputError: one is not.
    """
    for sensor in sensors:
        if sensor.position > rig["length"] * (1 + _SHORTENED):
            raise InputError(
                f"{sensor.channel} is {sensor.position:g} m from the hub axis; expected 0 to {rig['length']:g} m, "
                "the length of the link"
            )
