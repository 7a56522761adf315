"""Exact bending modes of a uniform Euler-Bernoulli beam between a hub and a payload.

    EI w'''' = rho omega^2 w,   w = 0,  EI w'' = -J0 omega^2 w'                              at the hub, x = 0
                                EI w'' = Jp omega^2 w',  EI w''' = -mp omega^2 w             at the tip, x = l

(Bossi et al. 2009, section III; end masses: L. Meirovitch, "Fundamentals of Vibrations", 2001.)
With the hub free to turn these are the shapes in the pseudo-pinned frame, which passes through the centre of
mass; with the hub clamped, w'(0) = 0 replaces the moment balance of the hub.

Private functions work in dimensionless variables: z = beta x, b = beta l, y' = dy/dz, and the end inertias enter as

    H = J0 / (rho l^3) b^3      M = mp / (rho l) b      J = Jp / (rho l^3) b^3
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

Boundary = Literal["free", "clamped"]

# Below this b a mode is a sum of Krylov functions, above it of exponentials that decay from either end. The former
# suffer cancellation at large b, the latter at small b; around 2 both are accurate to 1e-14.
_SMALL = 2.0
# 1 / (4 j + k)!, highest j first; the first omitted term is below 1e-25 at z = 2
_KRYLOV = tuple(tuple(1 / math.factorial(4 * j + k) for j in reversed(range(8))) for k in range(4))


@dataclass(frozen=True)
class Modes:
    """Bending modes in order of frequency, normalised to unit modal mass.

        rho int phi_i phi_j dx + mp phi_i(l) phi_j(l) + Jp phi_i'(l) phi_j'(l) + J0 phi_i'(0) phi_j'(0)

    is 1 for i = j and 0 otherwise (without the last term where the hub is clamped).

    Attributes:
      boundary: "free": the hub turns with its inertia (the rigid rotation is left out); "clamped": locked.
      frequencies: undamped natural frequencies (n) [rad/s], ascending.
      length: length of the link [m].
      roots: b = beta l of the characteristic equation (n) [1].
      coefficients: shape of each mode (n x 4): of the Krylov functions T1, T2, T3 (and 0) where b < 2;
        of sin z, cos z, exp(-z) and exp(z - b) elsewhere.
    """

    boundary: Boundary
    frequencies: np.ndarray
    length: float
    roots: np.ndarray
    coefficients: np.ndarray

    def __len__(self) -> int:
        return len(self.frequencies)

    def shape(self, x: ArrayLike, derivative: int = 0) -> np.ndarray:
        """Returns phi_i(x), or a derivative of it with respect to x.

        Sign: a free mode leaves the hub with phi'(0) > 0, a clamped one with phi''(0) > 0.

        Args:
          x: positions along the link (m,) or a number [m].
          derivative: order: 0 deflection, 1 slope, 2 curvature, 3 its derivative, and so on.

        Returns:
          (n x m) in kg^-1/2 m^-derivative.

        Raises:
          ValueError: a position is off the link.
        """
        xi = np.atleast_1d(np.asarray(x, dtype=float)) / self.length
        if not np.all((xi >= -1e-12) & (xi <= 1 + 1e-12)):
            raise ValueError(f"position {x!r} m is off the link; expected 0 to {self.length:g} m")
        z = np.outer(self.roots, xi)
        small = self.roots < _SMALL
        values = np.empty_like(z)
        values[small] = _combine(self.coefficients[small, :3], _krylov_basis(z[small], derivative))
        basis = _exponential_basis(z[~small], self.roots[~small, None], derivative)
        values[~small] = _combine(self.coefficients[~small], basis)
        return values * (self.roots[:, None] / self.length) ** derivative


class _Ends(NamedTuple):
    """Inertias at the ends of the link, relative to its own: J0/(rho l^3), mp/(rho l), Jp/(rho l^3)."""

    hub: float  # infinite: clamped
    mass: float
    inertia: float


def modes(rig: Mapping[str, float], n: int, boundary: Boundary = "free") -> Modes:
    """Returns the first `n` bending modes of the link of `rig`.

    Args:
      rig: bending_stiffness [N m^2], linear_density [kg/m], length [m], hub_inertia [kg m^2], tip_mass [kg],
        tip_inertia [kg m^2]. The last three may be 0.
      n: number of modes.
      boundary: "free": hub free to turn; "clamped": hub locked.

    Raises:
      ValueError: `n` is below 1, or the boundary is unknown, or a value of the rig is impossible.
    """
    if n < 1:
        raise ValueError(f"number of modes is {n}; expected 1 or more")
    if boundary not in get_args(Boundary):
        raise ValueError(f"Unsupported boundary: '{boundary}'. Expected one of: free, clamped")
    ends = _ends(rig, boundary)
    length, rho = rig["length"], rig["linear_density"]
    b, shapes = _unit_modes(ends, n)
    frequencies = b**2 * math.sqrt(rig["bending_stiffness"] / rho) / length**2
    return Modes(boundary, frequencies, float(length), b, shapes / math.sqrt(rho * length))


@functools.lru_cache(maxsize=64)  # a fit perturbs parameters one by one, and most are not these
def _unit_modes(ends: _Ends, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Roots (n) and coefficients (n x 4) of the first modes of a link of unit length and density; not to be written."""
    roots = _roots(ends, n)
    b, raw = np.array(roots), np.array([_shape_coefficients(root, ends) for root in roots])
    shapes = raw / np.sqrt(_modal_masses(b, raw, ends))[:, None]
    b.flags.writeable = shapes.flags.writeable = False
    return b, shapes


def static_tip_compliance(rig: Mapping[str, float]) -> float:
    """Deflection of the tip per force on it, hub clamped: l^3 / (3 EI) [m/N]."""
    return rig["length"] ** 3 / (3 * rig["bending_stiffness"])


def rigid_inertia(rig: Mapping[str, float]) -> float:
    """Inertia of hub, straight link and payload about the hub: J = J0 + rho l^3/3 + mp l^2 + Jp [kg m^2]."""
    length = rig["length"]
    link = rig["linear_density"] * length**3 / 3
    return rig["hub_inertia"] + link + rig["tip_mass"] * length**2 + rig["tip_inertia"]


def _ends(rig: Mapping[str, float], boundary: Boundary) -> _Ends:
    for name in ("bending_stiffness", "linear_density", "length"):
        if not rig[name] > 0:
            raise ValueError(f"{name} is {rig[name]:g}; expected a positive number")
    for name in ("hub_inertia", "tip_mass", "tip_inertia"):
        if not 0 <= rig[name] < math.inf:
            raise ValueError(f"{name} is {rig[name]:g}; expected 0 or a positive number")
    mass = rig["linear_density"] * rig["length"]
    inertia = mass * rig["length"] ** 2
    hub = math.inf if boundary == "clamped" else rig["hub_inertia"] / inertia
    return _Ends(hub, rig["tip_mass"] / mass, rig["tip_inertia"] / inertia)


# The characteristic equation


class _Products(NamedTuple):
    """Products of circular and hyperbolic functions of b, divided by cosh b so that none overflows."""

    difference: float  # cosh sin - sinh cos
    sum: float  # cosh sin + sinh cos
    minus: float  # 1 - cosh cos
    plus: float  # 1 + cosh cos
    cos: float  # cosh cos
    sin: float  # sinh sin
    cosh_cos: float  # cosh - cos
    sinh_sin: float  # sinh - sin


def _products(b: float) -> _Products:
    s, c, e = math.sin(b), math.cos(b), math.exp(-b)
    sech, tanh = 2 * e / (1 + e * e), (1 - e * e) / (1 + e * e)
    if b > 0.5:
        small = (s - tanh * c, sech - c, 1 - c * sech, tanh - s * sech)
    else:  # these four vanish as b^3, b^4, b^2 and b^3: series instead of differences
        z4 = b**4
        small = (
            sech * 4 * b**3 * (1 / 6 - z4 * (1 / 1260 - z4 / 2494800)),
            sech * z4 * (1 / 6 - z4 * (1 / 2520 - z4 / 7484400)),
            sech * 2 * _krylov(b, 2),
            sech * 2 * _krylov(b, 3),
        )
    return _Products(small[0], s + tanh * c, small[1], sech + c, c, tanh * s, small[2], small[3])


def _characteristic(b: float, ends: _Ends) -> float:
    """Characteristic function of b, whose roots are the modes; positive between b = 0 and the first.

    It is (pinned + H clamped) / (cosh b (1 + H)), with
      pinned  = cosh sin - sinh cos + 2 M sinh sin + 2 J cosh cos - J M (cosh sin - sinh cos)
      clamped = 1 + cosh cos - M (cosh sin - sinh cos) - J (cosh sin + sinh cos) + J M (1 - cosh cos)
    """
    q = _products(b)
    M, J = ends.mass * b, ends.inertia * b**3
    pinned = (1 - J * M) * q.difference + 2 * M * q.sin + 2 * J * q.cos
    clamped = q.plus - M * q.difference - J * q.sum + J * M * q.minus
    p, r = _hub_shares(b, ends)
    return p * pinned + r * clamped


def _hub_shares(b: float, ends: _Ends) -> tuple[float, float]:
    """Returns 1/(1 + H) and H/(1 + H): slope and negative curvature of a mode at the hub, up to a common factor."""
    if math.isinf(ends.hub):
        return 0.0, 1.0
    H = ends.hub * b**3
    return 1 / (1 + H), H / (1 + H)


def _modes_below(b: float, ends: _Ends) -> int:
    """Returns the exact number of elastic modes below b.

    It is the number of the beam clamped at both ends, plus the number of negative eigenvalues of the dynamic stiffness
    matrix of (hub angle, tip deflection, tip angle), less the rigid rotation (W. H. Wittrick, F. W. Williams, "A
    general algorithm for computing natural frequencies of elastic structures",
    Q. J. Mech. Appl. Math. 24, 1971).
    """
    q = _products(b)
    half_turns = math.floor(b / math.pi)
    both_clamped = half_turns - ((-1) ** half_turns * q.minus < 0) if half_turns else 0
    # Moment [EI/l] and force [EI/l^2] at the ends for unit rotation [1] and deflection [l].
    moment = b * q.difference / q.minus
    d22 = b**3 * q.sum / q.minus - ends.mass * b**4
    d23 = -(b**2) * q.sin / q.minus
    d33 = moment - ends.inertia * b**4
    if math.isinf(ends.hub):
        return both_clamped + _negative_pivots_2(d22, d23, d33)
    d11 = moment - ends.hub * b**4
    d12 = -(b**2) * q.cosh_cos / q.minus
    d13 = b * q.sinh_sin / q.minus
    d11 = d11 or np.finfo(float).tiny
    rest = _negative_pivots_2(d22 - d12**2 / d11, d23 - d12 * d13 / d11, d33 - d13**2 / d11)
    return both_clamped + (d11 < 0) + rest - 1


def _negative_pivots_2(a: float, b: float, c: float) -> int:
    """Number of negative eigenvalues of [[a, b], [b, c]]."""
    determinant = a * c - b * b
    return 1 if determinant < 0 else 2 * (a + c < 0)


def _roots(ends: _Ends, n: int) -> list[float]:
    """Returns the first n roots b of the characteristic equation; the mode count guarantees that none is missed."""
    # Dunkerley's bound for the clamped hub, below which the free link has no elastic mode either.
    low = 0.999 * (1 / 12 + ends.mass / 3 + ends.inertia) ** -0.25
    # With both ends clamped there are n + 1 modes below (n + 2) pi; releasing an end only adds modes.
    high = (n + 2) * math.pi
    brackets = _isolate(ends, low, 0, high, _modes_below(high, ends), n)
    return [_root(ends, *bracket) for bracket in brackets]


def _isolate(
    ends: _Ends, low: float, below_low: int, high: float, below_high: int, n: int
) -> list[tuple[float, float]]:
    """Bisects [low, high] until each interval holds at most one of the first n modes; returns the intervals that do."""
    if below_high <= below_low or below_low >= n:
        return []
    # Roots closer than double precision resolves share an interval.
    if high - low < 1e-14 * high:
        return [(low, high)] * (min(below_high, n) - below_low)
    if below_high == below_low + 1:
        return [(low, high)]
    middle = (low + high) / 2
    below = _modes_below(middle, ends)
    left = _isolate(ends, low, below_low, middle, below, n)
    return left + _isolate(ends, middle, below, high, below_high, n)


def _root(ends: _Ends, low: float, high: float) -> float:
    at_low, at_high = _characteristic(low, ends), _characteristic(high, ends)
    if at_low * at_high > 0:  # the root is an end of the bracket to within rounding
        return low if abs(at_low) < abs(at_high) else high
    return float(brentq(_characteristic, low, high, args=(ends,), xtol=1e-15, rtol=1e-15))


# Shapes


def _shape_coefficients(b: float, ends: _Ends) -> np.ndarray:
    """Coefficients (4) of a mode of any amplitude (see `Modes`).

    y = p T1 - r T2 + q T3 meets the conditions at the hub; q follows from the shear force at the tip,
    y'''(b) + M y(b) = 0, in which T0 + M T3 > 0 whatever the payload.
    """
    p, r = _hub_shares(b, ends)
    if math.isinf(ends.hub):
        r = -r  # a clamped mode leaves the hub with positive curvature
    M = ends.mass * b
    return _krylov_coefficients(b, p, r, M) if b < _SMALL else _exponential_coefficients(b, p, r, M)


def _krylov_coefficients(b: float, p: float, r: float, M: float) -> np.ndarray:
    t0, t1, t2, t3 = (_krylov(b, k) for k in range(4))
    q = -(p * (t2 + M * t1) - r * (t3 + M * t2)) / (t0 + M * t3)
    return np.array([p, -r, q, 0.0])


def _exponential_coefficients(b: float, p: float, r: float, M: float) -> np.ndarray:
    s, c, e = math.sin(b), math.cos(b), math.exp(-b)
    # The coefficient of the growing exponential, p - r + q, is of order exp(-b): computed without cancellation.
    tip = p * (c - M * s) + r / 2 * (M * (e - c + s) - (e + c + s))
    tip *= 4 / ((1 + e * e + 2 * c * e) + M * (1 - e * e - 2 * s * e))
    growth = tip * e
    return np.array([p - r / 2 - growth / 2, r / 2, -r / 2 - growth / 4, tip / 4])


def _modal_masses(b: np.ndarray, coefficients: np.ndarray, ends: _Ends) -> np.ndarray:
    """Modal masses (n) in units of rho l, in closed form from the values at both ends.

    int y^2 dz = 1/4 [z (y^2 + y''^2 - 2 y' y''') - y' y'' + 3 y y'''], since y'''' = y.
    """
    unit = Modes("free", b, 1.0, b, coefficients)
    ends_of_link = [unit.shape([0.0, 1.0], k) / b[:, None] ** k for k in range(4)]
    (y0, y), (d0, d), (dd0, dd), (ddd0, ddd) = (values.T for values in ends_of_link)
    integral = b * (y**2 + dd**2 - 2 * d * ddd) - d * dd + 3 * y * ddd + d0 * dd0 - 3 * y0 * ddd0
    hub = 0.0 if math.isinf(ends.hub) else ends.hub * (b * d0) ** 2
    return integral / (4 * b) + ends.mass * y**2 + ends.inertia * (b * d) ** 2 + hub


def _krylov(z: Any, k: int) -> Any:
    """T_k(z) = sum_j z^(4j+k) / (4j+k)!; T0..T3 = (cosh + cos, sinh + sin, cosh - cos, sinh - sin) / 2.

    T_k' = T_(k-1), with T_0' = T_3. z may be a number or an array.
    """
    z4, total = z**4, 0.0 * z
    for factor in _KRYLOV[k]:
        total = total * z4 + factor
    return total * z**k


def _krylov_basis(z: np.ndarray, derivative: int) -> list[np.ndarray]:
    return [_krylov(z, (k - derivative) % 4) for k in (1, 2, 3)]


def _exponential_basis(z: np.ndarray, b: np.ndarray, derivative: int) -> list[np.ndarray]:
    s, c = np.sin(z), np.cos(z)
    cycle = (s, c, -s, -c)
    return [
        cycle[derivative % 4],
        cycle[(derivative + 1) % 4],
        (-1) ** derivative * np.exp(-z),
        np.exp(z - b),
    ]


def _combine(coefficients: np.ndarray, basis: list[np.ndarray]) -> np.ndarray:
    """Returns sum_k coefficients[:, k] basis[k]; coefficients (n x k), each of the k basis functions (n x m)."""
    total = np.zeros_like(basis[0])
    for k, function in enumerate(basis):
        total += coefficients[:, k, None] * function
    return total
