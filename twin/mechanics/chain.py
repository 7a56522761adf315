"""The link as a chain of rigid segments joined by hinges with springs, fitted to the exact modes.

A chain of equal segments of length h with k = EI/h needs many of them, as the error of its frequencies is O(n^-2). Here
the lengths and masses of the segments and the stiffnesses of the hinges are the unknowns of a small least-squares
problem instead. Its targets: the first free and clamped frequencies, the static deflection and rotation of the tip,
the rig's mass moments, and the quadratic change of the modal masses with the deflection, on which the shift of the
frequencies with the amplitude depends. The regularisation favours equal segments. What remains of the error falls with
n^-2 as well: the modes beyond the targets, and the change with the amplitude.

Relative coordinates: hub angle, then the n hinge angles. Absolute coordinates: the angles of the n + 1 segments.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_simpson, simpson
from scipy.optimize import least_squares

from twin.mechanics import beam
from twin.mechanics.beam import Boundary

DEFAULT_SEGMENTS = 8
"""Number of hinges. `twin check` compares the chain's modes, statics and friction with the exact beam."""
SHAPE_PARAMETERS = ("length", "linear_density", "bending_stiffness", "hub_inertia", "tip_mass", "tip_inertia")
"""Parameters of a rig on which the proportions of its chain depend."""
_CACHED = 64  # shapes, chains and rows that are kept: more than a fit has unknowns that change them
_TARGET_MODES = 4
"""Modes of each boundary condition, free and clamped, that the fit targets; an impact on the hub excites them all.

Without the fourth as a target, its frequency is 14 % off on five segments, and 5 % on twelve."""
# Weights of the fit's residuals [1], chosen: of relative errors in units of 1e-3, and of log ratios to equal segments.
_UNIFORMITY_WEIGHT = 2.0  # of the log ratios of lengths, stiffnesses and densities: the regularisation
_FREQUENCY_WEIGHT = 60.0
_STATIC_WEIGHT = 25.0
_MOMENT_WEIGHT = 10.0
_CURVATURE_WEIGHT = np.array([1.0, 0.3, 0.1, 0.03])  # of the relative curvatures of modes
_AMPLITUDE_WEIGHT = (0.6, 0.15, 0.03)  # first free, first clamped, second free mode
_CONDENSED = 0.2
"""Compliance of a clamp, over that of a hinge [1], up to which the first hinges take it; one loses a quarter."""
_COARSEST, _FINEST = 8, 24  # smallest and largest number of segments of `twin.estimation.chain_limit`
_STABLE = 2.55  # [1] step times the size of the largest eigenvalue; RK4 is stable up to 2.6, see `Chain.largest_step`
_DIFFERENCE_STEP = 1e-4
"""Step of the fit's central differences [1]. With a step as short as forward differences need, rounding outweighs the
regularisation, and the solution depends on the kind of processor."""


@dataclass(frozen=True, eq=False)
class ChainShape:
    """Proportions of a chain, relative to the link's length, mass and EI/l; lengths and masses each sum to 1.

    Equal proportions are equal, and the same key of a cache, in every process.

    Attributes:
      lengths: (n + 1) of the segments, from the hub axis to the tip.
      masses: (n + 1) of the segments, each a uniform rod.
      stiffnesses: (n) of the hinges.
    """

    lengths: np.ndarray
    masses: np.ndarray
    stiffnesses: np.ndarray

    @property
    def segments(self) -> int:
        """Number of hinges n; the n + 1 rigid parts are half a segment, n - 1 whole ones, half a segment."""
        return len(self.stiffnesses)

    @functools.cached_property
    def _key(self) -> tuple[bytes, ...]:
        return tuple(values.tobytes() for values in (self.lengths, self.masses, self.stiffnesses))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ChainShape) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@dataclass(frozen=True, eq=False)
class Chain:
    """A chain with its dimensions, SI units; n hinges. One object stands for a rig in all models that have it.

    Attributes:
      shape: its proportions.
      lengths, masses: (n + 1) of the segments [m], [kg].
      stiffness: (n) of the hinges [N m/rad].
      damping: (n x n) moments on the hinges per hinge rate [N m s/rad].
      inertia: (n + 1 x n + 1) [kg m^2], c_ij of the kinetic energy
        1/2 sum c_ij cos(phi_i - phi_j) phi_i' phi_j'.
      first_moment: (n + 1) sum of mass times lever along each segment, over all that it carries [kg m].
      bending: (n) share of a hinge's angle that is bending of the link; the rest is rotation in a compliant clamp [1].
      rigid: the same chain on a rigid clamp; None where this one's clamp is rigid.
      root_stiffness: rotational stiffness of the clamp between hub and link [N m/rad].
    """

    shape: ChainShape
    lengths: np.ndarray
    masses: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    inertia: np.ndarray
    first_moment: np.ndarray
    bending: np.ndarray
    rigid: Chain | None = None
    root_stiffness: float = math.inf

    @property
    def hinges(self) -> np.ndarray:
        """Distances of the hinges from the hub axis (n) [m]."""
        return np.cumsum(self.lengths)[:-1]

    @property
    def levers(self) -> np.ndarray:
        """Distance of the tip from each hinge (n) [m]: its small deflection by a hinge angle."""
        return self.lengths.sum() - self.hinges

    def mass_matrix(self) -> np.ndarray:
        """Mass matrix of the straight chain in relative coordinates (n + 1 x n + 1) [kg m^2]."""
        return _relative(self.inertia)

    @functools.lru_cache(maxsize=_CACHED)  # noqa: B019 - the chains that it keeps are few and small
    def modes(self, boundary: Boundary = "free") -> tuple[np.ndarray, np.ndarray]:
        """Returns frequencies (n) [rad/s] and mass-normalised shapes (n + 1 x n) in relative coordinates, read-only."""
        frequencies, shapes = _modes(self.mass_matrix(), self.stiffness, boundary)
        frequencies.flags.writeable = shapes.flags.writeable = False
        return frequencies, shapes

    def damping_ratios(self, boundary: Boundary = "free") -> np.ndarray:
        """Returns the damping ratio of each mode (n) [1]; coupling of modes by damping is neglected."""
        frequencies, shapes = self.modes(boundary)
        bends = shapes[1:]
        return np.einsum("ki,kl,li->i", bends, self.damping, bends) / (2 * frequencies)

    def largest_step(self) -> float:
        """Returns the largest step [s] with which the classical fourth-order Runge-Kutta method is stable.

        Its stability region contains the left half of a disc of radius 2.6, in which every eigenvalue times the step
        has to lie. Not only the oscillating modes count: that of a compliant clamp may be overdamped.
        """
        return _STABLE / self._fastest

    @functools.cached_property
    def _fastest(self) -> float:
        """Size of the largest eigenvalue of the straight chain [1/s]; cached, as every simulation needs it."""
        n = len(self.stiffness)
        pliant = np.linalg.inv(self.mass_matrix())[1:, 1:]
        system = np.block([[np.zeros((n, n)), np.eye(n)], [-pliant * self.stiffness, -pliant @ self.damping]])
        return float(np.abs(np.linalg.eigvals(system)).max())

    @functools.lru_cache(maxsize=_CACHED)  # noqa: B019 - the chains that it keeps are few and small
    def with_slower_modes(self, step: float) -> Chain:
        """Returns the chain with inertia added to its fast modes, so that it is stable with this step [s].

        Slower modes with the hub free, static deflections and the rigid rotation stay as they are
        (L. Olovsson, K. Simonsson and M. Unosson, Int. J. Numer. Meth. Engng 63, 2005: selective mass scaling).
        """
        mass = self.mass_matrix()
        frequencies, shapes = self.modes("free")
        added = np.maximum((frequencies * step / _STABLE) ** 2 - 1, 0.0)
        if not added.any():
            return self
        momenta = mass @ shapes
        heavier = self.inertia + _absolute((momenta * added) @ momenta.T)
        return replace(self, inertia=heavier)

    def free_hub_inertia(self) -> float:
        """Initial torque per hub acceleration with free hinges [kg m^2]: only a little more than the hub's inertia."""
        M = self.mass_matrix()
        return float(M[0, 0] - M[0, 1:] @ np.linalg.solve(M[1:, 1:], M[1:, 0]))

    def static_tip_compliance(self) -> float:
        """Tip deflection per transverse tip force, hub clamped, small deflections [m/N]."""
        return float(np.sum(self.levers**2 / self.stiffness))


def build(
    rig: Mapping[str, float], segments: int = DEFAULT_SEGMENTS, shape: ChainShape | None = None
) -> Chain:
    """Returns the chain of a rig.

    Args:
      rig: length, linear_density, bending_stiffness, hub_inertia, tip_mass, tip_inertia, damping_ratio (SI).
      segments: number of hinges, at least 2.
      shape: proportions to use; by default those fitted to this rig.
    """
    values = tuple(float(rig[name]) for name in (*SHAPE_PARAMETERS, "damping_ratio"))
    return _built(values, fit_shape(rig, segments) if shape is None else shape)


@functools.lru_cache(maxsize=_CACHED)
def _built(values: tuple[float, ...], shape: ChainShape) -> Chain:
    rig = dict(zip((*SHAPE_PARAMETERS, "damping_ratio"), values, strict=True))
    lengths = rig["length"] * shape.lengths
    masses = rig["linear_density"] * rig["length"] * shape.masses
    stiffness = rig["bending_stiffness"] / rig["length"] * shape.stiffnesses
    inertia, first_moment = _inertia(lengths, masses, rig["hub_inertia"], rig["tip_mass"], rig["tip_inertia"])
    damping = _modal_damping(inertia, stiffness, rig["damping_ratio"])
    return Chain(shape, lengths, masses, stiffness, damping, inertia, first_moment, np.ones(len(stiffness)))


def with_root_compliance(links: Chain, hub_inertia: float, stiffness: float) -> Chain:
    """Returns a chain with a compliant clamp: a rotational spring of `stiffness` [N m/rad] between hub and link.

    A soft clamp becomes a hinge on the hub's axis, the first of n + 1. With a stiff one, that hinge would have a very
    high frequency and only shorten the time step. Its compliance is instead added to the first three hinges, with the
    weights of a Lagrange extrapolation to the hub's axis: the rotation is then exact for every bending moment that is
    quadratic along the link. The clamp has no damping.
    """
    compliance = 1 / stiffness
    weights = _extrapolation(links.hinges[:3])
    shares = np.zeros(len(links.stiffness))
    shares[: len(weights)] = compliance * weights * links.stiffness[: len(weights)]
    # Chains from which the limit of infinitely many segments is extrapolated must treat the clamp alike.
    count = _FINEST if len(shares) >= _COARSEST else len(shares)
    if compliance < _CONDENSED * np.sum(1 / links.stiffness) / count:
        bending = 1 / (1 + shares)
        damping = links.damping * np.outer(bending, bending)
        return replace(
            links,
            stiffness=links.stiffness * bending,
            damping=damping,
            bending=bending,
            rigid=links,
            root_stiffness=stiffness,
        )
    inertia = np.zeros((len(links.lengths) + 1,) * 2)
    inertia[1:, 1:] = links.inertia
    inertia[1, 1] -= hub_inertia
    inertia[0, 0] = hub_inertia
    return replace(
        links,
        lengths=np.r_[0.0, links.lengths],
        masses=np.r_[0.0, links.masses],
        stiffness=np.r_[stiffness, links.stiffness],
        damping=np.pad(links.damping, ((1, 0), (1, 0))),
        inertia=inertia,
        first_moment=np.r_[0.0, links.first_moment],
        bending=np.r_[0.0, np.ones(len(links.stiffness))],
        rigid=links,
        root_stiffness=stiffness,
    )


def _extrapolation(x: np.ndarray) -> np.ndarray:
    """Weights (k) with which values at x (k) give the value of their polynomial at 0 (Lagrange)."""
    return np.array([np.prod(np.delete(x, i) / (np.delete(x, i) - x[i])) for i in range(len(x))])


def fit_shape(rig: Mapping[str, float], segments: int = DEFAULT_SEGMENTS) -> ChainShape:
    """Returns the proportions that fit a chain to the exact beam of this rig; cached.

    Raises:
      ValueError: fewer than 2 segments.
    """
    if segments < 2:
        raise ValueError(f"At least 2 segments required. Received {segments}")
    return _fit_shape(tuple(rig[name] for name in SHAPE_PARAMETERS), segments)


def fit_shape_of_similar_rig(rig: Mapping[str, float], segments: int) -> ChainShape:
    """Returns `fit_shape` of a rig with rounded parameters, which the cache is likelier to have.

    A shape suits all similar rigs: the frequencies change by 1e-5.
    """
    return fit_shape({name: float(f"{rig[name]:.2g}") for name in SHAPE_PARAMETERS}, segments)


@functools.lru_cache(maxsize=_CACHED)
def _fit_shape(values: tuple[float, ...], segments: int) -> ChainShape:
    length, density, _, hub_inertia, tip_mass, tip_inertia = values
    # Units of the link's length, mass and bending stiffness.
    mass = density * length
    ends = (hub_inertia / (mass * length**2), tip_mass / mass, tip_inertia / (mass * length**2))
    unit = {"length": 1.0, "linear_density": 1.0, "bending_stiffness": 1.0}
    unit |= dict(zip(("hub_inertia", "tip_mass", "tip_inertia"), ends, strict=True))
    equal = uniform_shape(segments)
    count = min(segments, _TARGET_MODES)
    targets, weights = _targets(unit, count), _weights(count)

    def residual(z: np.ndarray) -> np.ndarray:
        shape = _perturbed(equal, z)
        errors = _compared_quantities(shape, ends, count) / targets - 1
        return np.concatenate([1e3 * weights * errors, _UNIFORMITY_WEIGHT * z], axis=-1)

    def slopes(z: np.ndarray) -> np.ndarray:
        steps = _DIFFERENCE_STEP * np.eye(len(z))
        return (residual(z + steps) - residual(z - steps)).T / (2 * _DIFFERENCE_STEP)

    start = np.zeros(3 * segments + 2)
    return _perturbed(equal, least_squares(residual, start, jac=slopes, xtol=1e-8, ftol=1e-10).x)


def uniform_shape(segments: int) -> ChainShape:
    """Returns the proportions of equal segments: half a one, n - 1 whole ones, half a one, hinges k = EI/h."""
    lengths = np.r_[0.5, np.ones(segments - 1), 0.5] / segments
    return ChainShape(lengths, lengths.copy(), np.full(segments, float(segments)))


def curvature_row(chain: Chain, rig: Mapping[str, float], x: float) -> np.ndarray:
    """Returns the row (n) from hinge angles to the link's curvature w'' at x [1/m per rad].

    A regularised least-squares fit to the exact curvature of the modes that the chain's fit targets, and of a static
    tip force and tip moment. Rotation in a compliant clamp is no curvature.

    Args:
      chain: the chain.
      rig: its rig: bending_stiffness, length, and the parameters of `beam.modes`.
      x: distance from the hub axis along the link [m].
    """
    if chain.rigid is not None:
        return row_with_root_compliance(chain, curvature_row(chain.rigid, rig, x))
    return _curvature_row(chain, tuple(float(rig[name]) for name in SHAPE_PARAMETERS), x)


@functools.lru_cache(maxsize=_CACHED)
def _curvature_row(chain: Chain, values: tuple[float, ...], x: float) -> np.ndarray:
    rig = dict(zip(SHAPE_PARAMETERS, values, strict=True))
    bends: list[np.ndarray] = []
    curvatures: list[float] = []
    weights: list[float] = []
    for boundary in ("free", "clamped"):
        count = min(chain.shape.segments, _TARGET_MODES)
        exact = beam.modes(rig, count, boundary)
        shapes = chain.modes(boundary)[1][1:, :count]
        bends.extend(shapes.T)
        curvatures.extend(exact.shape(x, 2)[:, 0])
        # Relative to the mode's largest curvature: at the gauge it may be zero.
        scale = np.abs(exact.shape(np.linspace(0, rig["length"], 41), 2)).max(axis=1)
        weights.extend(_CURVATURE_WEIGHT[:count] / scale)
    stiffness, lever = rig["bending_stiffness"], rig["length"] - x
    for bend, curvature in (
        (chain.levers / chain.stiffness, lever / stiffness),
        (1 / chain.stiffness, 1 / stiffness),
    ):
        bends.append(bend)
        curvatures.append(curvature)
        weights.append(stiffness / rig["length"] ** (1 if bend is bends[-2] else 0))
    scaled = np.array(bends) * np.array(weights)[:, None]
    ridge = 1e-4 * np.eye(len(chain.levers)) * np.abs(scaled).max()
    system = np.vstack([scaled, ridge])
    right = np.r_[np.array(curvatures) * np.array(weights), np.zeros(len(chain.levers))]
    return np.linalg.lstsq(system, right, rcond=None)[0]


def _inertia(
    lengths: np.ndarray, masses: np.ndarray, hub_inertia: float, tip_mass: float, tip_inertia: float
) -> tuple[np.ndarray, np.ndarray]:
    """Returns c_ij (..., n + 1, n + 1) and first moments (..., n + 1) of planar open chains of uniform rods."""
    count = lengths.shape[-1]
    # levers[b, i]: distance along segment i by which it carries the centre of mass of rod b
    levers = (np.tri(count, k=-1) + np.eye(count) / 2) * lengths[..., None, :]
    inertia = levers.mT @ (masses[..., None] * levers) + tip_mass * lengths[..., None] * lengths[..., None, :]
    inertia += np.eye(count) * (masses * lengths**2 / 12)[..., None]
    inertia[..., 0, 0] += hub_inertia
    inertia[..., -1, -1] += tip_inertia
    return inertia, (masses[..., None, :] @ levers)[..., 0, :] + tip_mass * lengths


def row_with_root_compliance(chain: Chain, row: np.ndarray) -> np.ndarray:
    """Returns the row (n) of a chain with a compliant clamp, from the row of the same chain on a rigid clamp."""
    return chain.bending * np.r_[np.zeros(len(chain.bending) - len(row)), row]


def curvature_rate_row(chain: Chain, row: np.ndarray) -> np.ndarray | None:
    """Returns the row (n) from hinge rates to the curvature [s/m per rad]; None where the curvature has no such part.

    A compliance c of the clamp is in series with a hinge, M = k b + D b' = (q - b) / c, b being the link's share of the
    hinge angle q. Damping makes b lag behind the static share S q; to first order b = S q - (1 - S) / k D S q'.

    Args:
      chain: the chain.
      row: (n) from hinge angles of the same chain on a rigid clamp to the curvature [1/m per rad].
    """
    links = chain.rigid
    if links is None or len(links.stiffness) != len(chain.stiffness):
        return None
    return -row @ (((1 - chain.bending) / links.stiffness)[:, None] * links.damping * chain.bending)


def _relative(inertia: np.ndarray) -> np.ndarray:
    """Returns mass matrices (..., n + 1, n + 1) in relative coordinates, T^T M T.

    phi = T [hub, hinges], T lower triangular of ones.
    """
    outboard = np.cumsum(inertia[..., ::-1, :], axis=-2)[..., ::-1, :]
    return np.cumsum(outboard[..., ::-1], axis=-1)[..., ::-1]


def _absolute(mass: np.ndarray) -> np.ndarray:
    """Returns the inertias c_ij of a mass matrix in relative coordinates: the inverse of `_relative`."""
    steps = np.eye(len(mass)) - np.eye(len(mass), k=-1)
    return steps.T @ mass @ steps


def _modes(mass: np.ndarray, stiffness: np.ndarray, boundary: Boundary) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (..., n) [rad/s] and shapes (..., n + 1, n) of unit modal mass, in relative coordinates.

    With the factors of M = L L^T, the modes are the eigenvectors of L^-1 K L^-T. Where the hub is free, the rigid
    rotation is left out.
    """
    first = 1 if boundary == "clamped" else 0
    inverse = np.linalg.inv(np.linalg.cholesky(mass[..., first:, first:]))
    of_hinges = inverse[..., 1 - first :]
    squares, vectors = np.linalg.eigh(of_hinges @ (stiffness[..., None] * of_hinges.mT))
    shapes = np.zeros((*mass.shape[:-1], stiffness.shape[-1]))
    shapes[..., first:, :] = inverse.mT @ vectors[..., 1 - first :]
    # Sign as in `beam.Modes`: the hub rotates, or the root bends, to the positive side.
    shapes *= np.sign(shapes[..., first : first + 1, :])
    return np.sqrt(squares[..., 1 - first :]), shapes


def _modal_damping(inertia: np.ndarray, stiffness: np.ndarray, ratio: float) -> np.ndarray:
    """Returns D (n x n) = sum_i (M phi_i) 2 zeta omega_i (M phi_i)^T over the free modes, restricted to the hinges.

    Its hub row is zero, as phi_i is orthogonal to the rigid rotation: modal damping does not brake that.
    """
    mass = _relative(inertia)
    frequencies, shapes = _modes(mass, stiffness, "free")
    momenta = (mass @ shapes)[1:]
    return (momenta * (2 * ratio * frequencies)) @ momenta.T


def _perturbed(shape: ChainShape, z: np.ndarray) -> ChainShape:
    """Returns a shape with log ratios z (..., 3n + 2) applied.

    Those of lengths (..., n + 1), stiffnesses (..., n), densities (..., n + 1).
    """
    n = shape.segments
    lengths = shape.lengths * np.exp(z[..., : n + 1])
    lengths /= lengths.sum(axis=-1, keepdims=True)
    masses = lengths * np.exp(z[..., 2 * n + 1 :])
    masses /= masses.sum(axis=-1, keepdims=True)
    return ChainShape(lengths, masses, shape.stiffnesses * np.exp(z[..., n + 1 : 2 * n + 1]))


def _weights(modes: int) -> np.ndarray:
    """Weights of the quantities of `_compared_quantities`, in their order."""
    groups = ((2 * modes, _FREQUENCY_WEIGHT), (3, _STATIC_WEIGHT), (2, _MOMENT_WEIGHT))
    return np.r_[*(np.full(*group) for group in groups), _AMPLITUDE_WEIGHT]


def _compared_quantities(shape: ChainShape, ends: tuple[float, float, float], modes: int) -> np.ndarray:
    """Quantities (..., q) of a chain, or of some, that the fit compares with `_targets`, in units of the link."""
    inertia, first_moment = _inertia(shape.lengths, shape.masses, *ends)
    mass = _relative(inertia)
    free, free_shapes = _modes(mass, shape.stiffnesses, "free")
    clamped, clamped_shapes = _modes(mass, shape.stiffnesses, "clamped")
    levers = 1 - np.cumsum(shape.lengths, axis=-1)[..., :-1]
    flexibility = 1 / shape.stiffnesses
    static = [np.sum(levers**k * flexibility, axis=-1) for k in (2, 1, 0)]
    moments = [first_moment.sum(axis=-1), mass[..., 0, 0]]
    stretched = [
        _chain_mass_change(inertia, np.cumsum(column, axis=-1))
        for column in (free_shapes[..., 0], clamped_shapes[..., 0], free_shapes[..., 1])
    ]
    others = np.stack([*static, *moments, *stretched], axis=-1)
    return np.concatenate([free[..., :modes], clamped[..., :modes], others], axis=-1)


def _targets(unit: Mapping[str, float], modes: int) -> np.ndarray:
    """The same quantities of the exact beam."""
    free, clamped = (beam.modes(unit, max(modes, 2), boundary) for boundary in ("free", "clamped"))
    static = (1 / 3, 1 / 2, 1.0)
    moments = (1 / 2 + unit["tip_mass"], beam.rigid_inertia(unit))
    stretched = [_beam_mass_change(unit, *which) for which in ((free, 0), (clamped, 0), (free, 1))]

    return np.r_[free.frequencies[:modes], clamped.frequencies[:modes], static, moments, stretched]


def _chain_mass_change(inertia: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """m2 (...) of the modal mass 1 + m2 delta^2 of chains that move in one shape each: absolute angles (..., n + 1)."""
    other = angles[..., None, :]
    weight = inertia * (angles[..., None] - other) ** 2 * angles[..., None] * other
    return -0.5 * weight.sum(axis=(-2, -1))


def _beam_mass_change(unit: Mapping[str, float], modes: beam.Modes, index: int) -> float:
    """m2 of the inextensible beam: m2 = - int dm(x) (I1 I3 - I2^2), I_k(x) = int_0^x slope^k.

    From v^2(x) = int int_0^x cos(psi - psi') psi_t psi_t' ds ds', expanded to second order in the slopes.
    """
    x = np.linspace(0, 1, 401)
    slope = modes.shape(x, 1)[index]
    first, second, third = (cumulative_simpson(slope**k, x=x, initial=0) for k in (1, 2, 3))
    change = first * third - second**2
    return float(-simpson(change, x=x) - unit["tip_mass"] * change[-1])
