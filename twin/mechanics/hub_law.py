"""Torques on the hub as functions of time, angle and rate, which the compiled equations of motion call.

How an effect adds a torque to the right-hand side of the hub's equation, Q_0 in `twin.mechanics.plant`:

    1. Write a plain function f(t, theta, omega, values) that returns a torque [N m], positive towards positive angles:
       t [s] from the start of a recording, theta [rad] and omega [rad/s] of the hub, `values` its parameters as a
       sequence of floats. Decorate it with `HubLaw`. A viscous friction, say, is

           @HubLaw
           def viscous(t, theta, omega, values):
               return -values[0] * omega

    2. Pair it with the values of its parameters: HubTorque("viscous", viscous, (0.002,)).
    3. `as_arrays` packs all torques of a model into `Torques`, a field of `Plant`; compiled code sums them.

Each law is compiled to a C function and called by its address, so that a new law needs no change in the equations of
motion, and one from another package is as fast as one of this package.
"""

from __future__ import annotations

import functools
import itertools
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import llvmlite.ir as ir
import numpy as np
from numba import cfunc, types
from numba.extending import intrinsic

if TYPE_CHECKING:
    from mujoco import MjSpec

_SIGNATURE = types.float64(types.float64, types.float64, types.float64, types.CPointer(types.float64))
_TIMES, _ANGLES, _RATES = (0.0, 0.37, 1.9), (-2.1, 0.0, 0.8, 3.0), (-7.0, 0.0, 1.3, 12.0)
"""Grid on which a law is tested for linearity [s], [rad], [rad/s]; without integer ratios, so that no period hides."""
_ROUNDING = 1e-9  # [1] departure from a plane, relative to the largest torque, up to which a law is linear
_NEGLIGIBLE = 1e-12  # N m, torque below which the law is zero everywhere


class HubLaw:
    """A torque on the hub, f(t, theta, omega, values) [N m]; compiled when it is first simulated."""

    def __init__(self, function: Callable[[float, float, float, Sequence[float]], float]) -> None:
        """Takes the function, for numba's nopython mode: arithmetic, `math` and scalar `numpy` functions."""
        self.function = function
        functools.update_wrapper(self, function)

    def __call__(self, t: float, theta: float, omega: float, values: Sequence[float]) -> float:
        """Torque [N m] at a time [s], hub angle [rad] and rate [rad/s]."""
        return self.function(t, theta, omega, values)

    @property
    def _can_be_cached(self) -> bool:
        """Whether another process finds the function again: in a module that can be imported."""
        module = sys.modules.get(self.function.__module__)
        return getattr(module, "__spec__", None) is not None

    @functools.cached_property
    def address(self) -> int:
        """Address of the compiled function in this process."""
        # The machine code lives as long as this object: keep a reference.
        self._compiled = cfunc(_SIGNATURE, cache=self._can_be_cached)(self.function)
        address: int = self._compiled.address  # type: ignore[assignment]
        return address


class LinearTorque(NamedTuple):
    """The torque constant - stiffness theta - damping omega; [N m], [N m/rad], [N m s/rad]."""

    constant: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True)
class HubTorque:
    """A law with the values of its parameters.

    Attributes:
      name: name of the effect that it belongs to, say.
      law: the function.
      values: its parameters.
      on_motor: with backlash, it acts on the motor instead of the hub.
      write: writes a law that is not linear into a MuJoCo specification, for the joint of the given name; None where
        MuJoCo has no element for it.
      exact: whether the written element is exact at any time step.
    """

    name: str
    law: HubLaw
    values: tuple[float, ...]
    on_motor: bool = False
    write: Callable[[MjSpec, str], None] | None = None
    exact: bool = True

    def at(self, t: float, theta: float, omega: float) -> float:
        """Torque [N m] at a time [s], hub angle [rad] and rate [rad/s]."""
        return self.law(t, theta, omega, self.values)

    @functools.cached_property
    def linear(self) -> LinearTorque | None:
        """The law as a linear function of angle and rate; None where it is not linear or depends on time."""
        return self._fitted_plane(0.0)

    @functools.cached_property
    def linear_part(self) -> LinearTorque | None:
        """The law less its torque at theta = omega = 0, as a linear function; None where that is not linear.

        A law with an additive function of time has one.
        """
        return self._fitted_plane(1.0)

    def _fitted_plane(self, at_rest: float) -> LinearTorque | None:
        """Returns the plane through the torques on a grid of times, angles and rates; None where they are not on one.

        From each, `at_rest` [1] times the torque at zero angle and rate is subtracted.
        """
        places = np.array(list(itertools.product(_TIMES, _ANGLES, _RATES)))
        torques = np.array(
            [self.at(t, *place) - at_rest * self.at(t, 0.0, 0.0) for t, *place in places.tolist()]
        )
        plane = np.column_stack([np.ones(len(places)), -places[:, 1], -places[:, 2]])
        coefficients = np.linalg.lstsq(plane, torques, rcond=None)[0]
        rounding = _ROUNDING * max(np.abs(torques).max(), _NEGLIGIBLE)
        if np.abs(torques - plane @ coefficients).max() > rounding:
            return None
        return LinearTorque(*np.where(np.abs(coefficients) > rounding, coefficients, 0.0).tolist())


class Torques(NamedTuple):
    """Hub torques (k) as arrays, for compiled code.

    Attributes:
      addresses: (k) of the compiled laws.
      first: (k) index in `values` of the first value of each law.
      values: (n) parameters of all laws, concatenated.
      on_motor: (k) whether each acts on the motor of a plant with backlash.
      since: instant at which the laws' time t is 0 [s]: the start of a recording.
    """

    addresses: np.ndarray
    first: np.ndarray
    values: np.ndarray
    on_motor: np.ndarray
    since: float = 0.0

    def select(self, kept: np.ndarray) -> Torques:
        """Returns the torques whose entry of the mask `kept` (k) is true."""
        return self._replace(
            addresses=self.addresses[kept], first=self.first[kept], on_motor=self.on_motor[kept]
        )


def as_arrays(torques: Sequence[HubTorque]) -> Torques:
    """Returns the torques as arrays; compiles their laws."""
    counts = [len(t.values) for t in torques]
    return Torques(
        np.array([t.law.address for t in torques], dtype=np.int64),
        np.array([0, *np.cumsum(counts)][: len(torques)], dtype=np.int64),
        np.array([v for t in torques for v in t.values] or [0.0], dtype=float),
        np.array([t.on_motor for t in torques], dtype=bool),
    )


NO_TORQUES = as_arrays(())


@intrinsic
def call(typingctx, address, t, theta, omega, values, first):
    """Calls the law at an address (int64) with (t, theta, omega) and a pointer to values[first]; compiled code only."""

    def generate(context, builder, signature, arguments):
        function, *place, array, start = arguments
        data = context.make_array(signature.args[4])(context, builder, value=array).data
        real = ir.DoubleType()
        law = ir.FunctionType(real, [real, real, real, real.as_pointer()]).as_pointer()
        return builder.call(builder.inttoptr(function, law), [*place, builder.gep(data, [start])])

    number = types.float64
    return number(types.int64, number, number, number, values, types.int64), generate
