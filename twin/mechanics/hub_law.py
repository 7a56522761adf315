"""Torques on the hub as functions of time, angle and rate, compiled so that the equations of motion can call them.

A law is a plain function f(t, theta, omega, values) that returns a torque [N m]. `values` are the numbers that it
reads, in an order of its own. The equations of motion call it by its address: a new law needs no change there, and a
law of a package elsewhere is as fast as one of this package.
"""

from __future__ import annotations

import functools
import itertools
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
"""Where a law is evaluated to find whether it is linear [s], [rad], [rad/s]; no two are in a whole ratio."""
_ROUNDING = 1e-9  # part of its largest value by which a linear law may be off a plane
_NOTHING = 1e-12  # N m


class HubLaw:
    """A torque on the hub, f(t, theta, omega, values) [N m]; compiled when it is first simulated."""

    def __init__(self, function: Callable[[float, float, float, Sequence[float]], float]) -> None:
        """Takes the function; it is compiled in numba's nopython mode: arithmetic, `math` and `numpy` scalars."""
        self.function = function
        functools.update_wrapper(self, function)

    def __call__(self, t: float, theta: float, omega: float, values: Sequence[float]) -> float:
        """Torque [N m] at a time [s], hub angle [rad] and rate [rad/s]."""
        return self.function(t, theta, omega, values)

    @functools.cached_property
    def address(self) -> int:
        """Address of the compiled function in this process."""
        # Kept: what it compiled lives as long as it does.
        self._compiled = cfunc(_SIGNATURE, cache=True)(self.function)
        address: int = self._compiled.address  # type: ignore[assignment]
        return address


class LinearTorque(NamedTuple):
    """Torque constant - stiffness theta - damping omega [N m], [N m/rad], [N m s/rad]."""

    constant: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True)
class HubTorque:
    """A law with its values, as it acts in a model.

    Attributes:
      name: of what it stands for, an effect say.
      law: the function.
      values: the numbers that it reads.
      on_motor: where there is a play between motor and hub, it acts on the motor.
      write: writes a law that is not linear into a MuJoCo specification, for a joint of this name; None where
        MuJoCo has no element for it.
      exact: whether what is written is exact with any time step.
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
        """The law as a linear function of angle and rate; None where it is none, or depends on time."""
        return self._plane(0.0)

    @functools.cached_property
    def linear_part(self) -> LinearTorque | None:
        """The same of what depends on angle and rate alone, its constant 0; None where that is not linear."""
        return self._plane(1.0)

    def _plane(self, at_rest: float) -> LinearTorque | None:
        """A plane through the torques at a grid of times, angles and rates, so much of those at rest taken away."""
        places = np.array(list(itertools.product(_TIMES, _ANGLES, _RATES)))
        torques = np.array(
            [self.at(t, *place) - at_rest * self.at(t, 0.0, 0.0) for t, *place in places.tolist()]
        )
        plane = np.column_stack([np.ones(len(places)), -places[:, 1], -places[:, 2]])
        found = np.linalg.lstsq(plane, torques, rcond=None)[0]
        rounding = _ROUNDING * max(np.abs(torques).max(), _NOTHING)
        if np.abs(torques - plane @ found).max() > rounding:
            return None
        return LinearTorque(*np.where(np.abs(found) > rounding, found, 0.0).tolist())


class Torques(NamedTuple):
    """Hub torques (k) as the compiled equations of motion read them.

    Attributes:
      addresses: (k) of the laws.
      first: (k) index in `values` of the first value of each.
      values: (n) of all laws, one after the other.
      on_motor: (k) whether each acts on the motor of a play.
      since: instant from which the time of the laws counts [s]: the start of a recording.
    """

    addresses: np.ndarray
    first: np.ndarray
    values: np.ndarray
    on_motor: np.ndarray
    since: float = 0.0

    def select(self, kept: np.ndarray) -> Torques:
        """Those torques alone of which `kept` (k) is true."""
        return self._replace(
            addresses=self.addresses[kept], first=self.first[kept], on_motor=self.on_motor[kept]
        )


def as_arrays(torques: Sequence[HubTorque]) -> Torques:
    """The torques as the compiled equations of motion read them."""
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
    """Calls the law at an address with the values from index `first` of an array on."""

    def generate(context, builder, signature, arguments):
        function, *place, array, start = arguments
        data = context.make_array(signature.args[4])(context, builder, value=array).data
        real = ir.DoubleType()
        law = ir.FunctionType(real, [real, real, real, real.as_pointer()]).as_pointer()
        return builder.call(builder.inttoptr(function, law), [*place, builder.gep(data, [start])])

    number = types.float64
    return number(types.int64, number, number, number, values, types.int64), generate
