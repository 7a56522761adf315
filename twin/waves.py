"""Orders and phases of effects that repeat with the angle or with time, from the spectrum of what is unexplained.

At neutral the order of a wave has no slope. For each order of a grid the residual is regressed on sine and cosine,
the declared parameters free to give way; where the gain peaks, a fit can start.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.signal import cont2discrete, lfilter

from twin import driven, fit
from twin.chain import Chain
from twin.effects.base import Effect
from twin.effects.wave import Wave
from twin.fit import Fit, Workbench
from twin.model import Model

_PEAKS = 3
_FINEST = 0.05  # smallest step of an order
_HIGHEST = {"torque": 60.0, "friction": 60.0, "reading": 30.0, "time": 30.0}
_LOWEST = {"torque": 0.5, "friction": 0.5, "reading": 0.5, "time": 0.1}

Columns = dict[int, np.ndarray]
"""Index of a group -> (rows, k) slopes of its residual."""


@dataclass(frozen=True)
class Peak:
    """A place in the spectrum.

    Attributes:
      order: of the wave, per radian; of a wave in time its frequency [Hz].
      amplitude, phase: by regression.
      gain: drop of half the weighted squares.
    """

    order: float
    amplitude: float
    phase: float
    gain: float

    def start(self, effect: Effect) -> dict[str, float]:
        """The effect's parameters there."""
        return {"amplitude": self.amplitude, _wave(effect).order: self.order, "phase": self.phase}


def peaks(bench: Workbench, base: Fit, effect: Effect) -> tuple[Peak, ...]:
    """The highest peaks of the spectrum, best first."""
    scan = _Scan.of(bench, base, effect)
    if scan is None:
        return ()
    found = [scan.at(order) for order in scan.orders]
    gains = np.array([peak.gain for peak in found])
    inner = np.r_[-np.inf, gains, -np.inf]
    tops = np.flatnonzero((inner[1:-1] >= inner[:-2]) & (inner[1:-1] > inner[2:]))
    best = tops[np.argsort(-gains[tops])[:_PEAKS]]
    return tuple(found[k] for k in best if found[k].amplitude > 0)


def slopes(bench: Workbench, base: Fit, effect: Effect, peak: Peak) -> np.ndarray:
    """Slopes (n x k) of the residual for the wave at one of its `peaks`, for `fit.slope_gain`."""
    scan = _Scan.of(bench, base, effect)
    if scan is None:
        return np.zeros((len(base.residual), 0))
    parts = scan.columns(peak.order)
    width = next(iter(parts.values())).shape[1]
    found = np.zeros((len(base.residual), width))
    for index, columns in parts.items():
        found[bench.groups[index].rows] = columns
    return found


@dataclass(frozen=True)
class _Scan:
    """The base's part of the regressions, computed once."""

    bench: Workbench
    base: Fit
    weights: np.ndarray
    information: np.ndarray  # of the base's unknowns (p x p)
    gradient: np.ndarray  # (p)
    orders: np.ndarray
    columns: Callable[[float], Columns]

    @staticmethod
    def of(bench: Workbench, base: Fit, effect: Effect) -> _Scan | None:
        acts, data = _wave(effect).acts, cast(driven.DrivenData, bench.data)
        channels = {"hub_torque"} if acts != "reading" else None
        motions = {
            i: driven.move(data.views[i], p, base.model, base.starts[i])[0]
            for i, p in enumerate(data.prepared)
            if p.hub is not None
        }
        groups = [
            (k, g)
            for k, g in enumerate(bench.groups)
            if g.recording in motions
            and g.channel not in ("break_away", "motor_torque")
            and (channels is None or g.channel in channels)
        ]
        if not groups:
            return None
        views = {i: data.views[i] for i in motions}
        angles = {i: m.angles[:, 0] for i, m in motions.items()}
        directions = {i: m.modes for i, m in motions.items()}
        orders = _grid(acts, views, angles)

        def columns(order: float) -> Columns:
            found: Columns = {}
            for i, view in views.items():
                waves = _waves(acts, order, view, angles[i], directions[i])
                parts = dict(_responses(acts, waves, view, base.model))
                for k, g in groups:
                    if g.recording == i:
                        found[k] = parts[g.channel] * bench.weight[g.rows][:, None]
            return found

        weights = fit.row_weights(bench, base.residual)
        information, gradient = fit.normal_equations(bench, base)
        return _Scan(bench, base, weights, information, gradient, orders, columns)

    def at(self, order: float) -> Peak:
        """The regression at one order."""
        J, r, w = self.base.jacobian, self.base.residual, self.weights
        found = self.columns(order)
        k, p = next(iter(found.values())).shape[1], J.shape[1]
        squares, mixed, slope = np.zeros((k, k)), np.zeros((k, p)), np.zeros(k)
        for index, columns in found.items():
            rows = self.bench.groups[index].rows
            weighted = (w[rows][:, None] * columns).T
            squares += weighted @ columns
            mixed += weighted @ J[rows]
            slope += weighted @ r[rows]
        within = np.linalg.lstsq(self.information, np.c_[mixed.T, self.gradient], rcond=None)[0]
        left = squares - mixed @ within[:, :-1]
        pull = slope - mixed @ within[:, -1]
        scale = np.sqrt(np.maximum(np.diag(left), 1e-300))
        move = -np.linalg.lstsq(left / np.outer(scale, scale), pull / scale, rcond=1e-6)[0] / scale
        gain = float(-0.5 * pull @ move)
        amplitude, phase = float(np.hypot(*move[:2])), float(np.arctan2(move[1], move[0]))
        return Peak(float(order), amplitude, phase, gain)


def _wave(effect: Effect) -> Wave:
    if effect.wave is None:
        raise ValueError(f"{effect.name} is not a wave.")
    return effect.wave


def _grid(acts: str, views: Mapping[int, driven.View], angles: Mapping[int, np.ndarray]) -> np.ndarray:
    """Orders close enough that no peak falls between two."""
    if acts == "time":
        widest = max(v.time[-1] - v.time[0] for v in views.values())
        step = 0.25 / widest
    else:
        widest = max(float(np.ptp(angle)) for angle in angles.values())
        step = max(1.0 / max(widest, 1e-3), _FINEST)
    low = max(_LOWEST[acts], 0.0 if acts == "time" else 0.5 / max(widest, 1e-3))
    return np.arange(low, _HIGHEST[acts], step)


def _waves(
    acts: str, order: float, view: driven.View, angle: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Sine and cosine (m x k) of the order, as they act."""
    x = 2 * np.pi * view.time if acts == "time" else angle
    waves = np.stack([np.sin(order * x), np.cos(order * x)], axis=1)
    if acts == "friction":
        return -0.5 * direction[:, None] * np.c_[waves, np.ones(len(x))]
    return waves


def _responses(
    acts: str, waves: np.ndarray, view: driven.View, model: Model
) -> Iterator[tuple[str, np.ndarray]]:
    """Channel -> (m x k) change of the residual, noise units."""
    if acts != "reading":
        filtered = driven.low_passed(waves.T, driven.GRID).T
        yield "hub_torque", -filtered / view.noise["hub_torque"]
        return
    error = driven.low_passed(waves.T, driven.GRID, view.band)
    acceleration = np.gradient(np.gradient(error, driven.GRID, axis=1), driven.GRID, axis=1)
    for channel, response in _under_hub(model, acceleration).items():
        if channel in view.noise:
            filtered = driven.low_passed(response, driven.GRID).T
            sign = -1.0 if channel == "hub_torque" else 1.0
            yield channel, sign * filtered / view.noise[channel]


def _under_hub(model: Model, acceleration: np.ndarray) -> dict[str, np.ndarray]:
    """Torque on the hub and strains (k x m) that small hub accelerations (k x m) [rad/s^2] take.

    In clamped modes q'' + 2 zeta omega q' + omega^2 q = -g alpha, and the torque is J alpha + sum g q''.
    """
    chain: Chain = model.chain
    mass = chain.mass_matrix()
    frequencies, shapes = chain.modes("clamped")
    ratios = chain.damping_ratios("clamped")
    torque = mass[0, 0] * acceleration
    strains = {c: np.zeros_like(acceleration) for c in model.curvature_rows}
    for omega, zeta, shape in list(zip(frequencies, ratios, shapes[1:].T, strict=True))[:3]:
        g = float(mass[0, 1:] @ shape)
        numerator, denominator = _sampled(omega, zeta)
        q = lfilter(numerator, denominator, -g * acceleration, axis=1)
        rate_of = np.gradient(np.gradient(q, driven.GRID, axis=1), driven.GRID, axis=1)
        torque = torque + g * rate_of
        for channel, row in model.curvature_rows.items():
            strains[channel] += model.sensors[channel].half_thickness * float(row @ shape) * q
    return {"hub_torque": torque, **strains}


def _sampled(omega: float, zeta: float) -> tuple[np.ndarray, np.ndarray]:
    """1/(s^2 + 2 zeta omega s + omega^2) on the grid, its input linear in between."""
    system = (np.array([1.0]), np.array([1.0, 2 * zeta * omega, omega**2]))
    numerator, denominator, _ = cont2discrete(system, driven.GRID, method="foh")
    return np.ravel(numerator), denominator
