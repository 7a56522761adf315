"""Order and phase of effects that are periodic in the hub angle or in time, from a spectrum of the residuals.

At neutral, where the amplitude is 0, the residual does not depend on the order of a wave, so that a fit cannot find
it. For each order on a grid the residual is regressed on sine and cosine of the wave, with the unknowns of the fit as
nuisance parameters (a least-squares spectrum). The gain in log likelihood over the order is the spectrum; a fit starts
from its peaks.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy.fft import next_fast_len, rfft, rfftfreq
from scipy.signal import cont2discrete, lfilter

from twin.effects.base import Effect
from twin.effects.wave import RESONANCE_DAMPING, Wave
from twin.estimation.fit import Fit
from twin.estimation.slopes import normal_equations, root_diagonal, row_weights
from twin.estimation.workbench import Workbench
from twin.mechanics.state import Motion
from twin.recording import HUB_TORQUE
from twin.residuals.data import DrivenData
from twin.residuals.filters import BAND, GRID, STRIDE, low_pass_gain, low_passed
from twin.residuals.residual import EVENT_CHANNELS, scaled_change
from twin.residuals.view import View, move_link
from twin.rigs.model import Model

_PEAKS = 3  # peaks of a spectrum that are returned or tried
_NEIGHBOURS = 60  # grid points to either side over which the local level of a spectrum is taken
_SMALLEST_STEP = 0.05  # of the order
_SEEN_BY_STRAINS = ("reading", "resonance", "shake")
"""Kinds of wave whose regression uses the sensors of the link, too."""
_COEFFICIENTS = (HUB_TORQUE, "strain_base", "strain_mid")
"""Channels whose own coefficient the response to an oscillator has: inertia share, sensitivities of the bridges."""
_HIGHEST = {"torque": 60.0, "friction": 60.0, "reading": 30.0, "time": 30.0, "resonance": 55.0}
_LOWEST = {"torque": 1.0, "friction": 1.0, "reading": 1.0, "time": 0.1, "resonance": 5.0}
"""Ends of the grid, per radian; of "time" and "resonance" [Hz]."""

Columns = dict[int, np.ndarray]
"""Index of a group -> (k, orders, rows) derivatives of its residual."""


@dataclass(frozen=True)
class Peak:
    """A peak of a spectrum.

    Attributes:
      order: of the wave [per radian]; of a wave in time or a resonance its frequency [Hz].
      coefficients: (k) of the regression.
      gain: drop of half the weighted sum of squares.
      comparisons: number of peaks of the spectrum.
      level: local level of a spectrum over time in units of white noise; 1 of any other spectrum.
      acts: kind of the wave, see `Wave.acts`; "shake" is an acceleration of the base.
    """

    order: float
    coefficients: tuple[float, ...]
    gain: float
    comparisons: int = 1
    level: float = 1.0
    acts: str = ""


def spectral_peaks(bench: Workbench, base: Fit, effect: Effect) -> tuple[Peak, ...]:
    """The highest peaks of the spectrum of an effect with a wave, by gain, highest first."""
    scan = _Scan.of(bench, base, _wave(effect).acts)
    if scan is None:
        return ()
    orders = _grid(scan.acts, list(scan.motions.values()))
    chunks = np.array_split(orders, math.isqrt(len(orders)) + 1)
    points = [point for some in bench.pool.map(scan.at, chunks) for point in some]
    gains = np.array([point.gain for point in points])
    maxima = _local_maxima(gains)
    best = maxima[np.argsort(-gains[maxima])[:_PEAKS]]
    in_time = scan.acts == "time"
    highest = [
        replace(points[k], comparisons=len(maxima), level=_local_level(gains, k) if in_time else 1.0)
        for k in best
        if points[k].gain > 0
    ]
    of_base = _base_acceleration_peaks(bench, base, orders) if in_time else []
    # The expected gain of a coefficient in noise is 1/2.
    return tuple(sorted([*highest, *of_base], key=lambda peak: -peak.gain + 0.5 * len(peak.coefficients)))


def _base_acceleration_peaks(bench: Workbench, base: Fit, frequencies: np.ndarray) -> list[Peak]:
    """The best of the few frequencies with the strongest residuals, for an acceleration of the base; or none."""
    scan = _Scan.of(bench, base, "shake")
    if scan is None:
        return []
    power = _residual_power(scan, frequencies)
    maxima = _local_maxima(power)
    levels = np.array([_local_median(power, k) for k in maxima])
    chosen = np.argsort(-power[maxima] / levels)[:_PEAKS]
    peaks = scan.at(frequencies[maxima[chosen]])
    best = int(np.argmax([peak.gain for peak in peaks]))
    if peaks[best].gain <= 0:
        return []
    return [replace(peaks[best], comparisons=len(maxima), level=max(1.0, float(levels[chosen[best]])))]


def _residual_power(scan: _Scan, frequencies: np.ndarray) -> np.ndarray:
    """Power spectrum (f) of the residuals at evenly spaced frequencies [Hz], relative to its median."""
    period = STRIDE * GRID
    size = next_fast_len(round(1 / ((frequencies[1] - frequencies[0]) * period)))
    total = np.zeros(len(frequencies))
    for group in (scan.bench.data.groups[k] for k in scan.groups):
        signal = scan.base.residual[group.rows] * np.sqrt(scan.weights[group.rows])
        length = max(size, len(signal))
        power = np.abs(rfft(signal, length)) ** 2
        total += np.interp(frequencies, rfftfreq(length, period), power) / max(
            float(power.mean()), np.finfo(float).tiny
        )
    return total / np.median(total)


def _local_maxima(spectrum: np.ndarray) -> np.ndarray:
    """Indices of the local maxima of a spectrum (o), its ends included."""
    padded = np.r_[-np.inf, spectrum, -np.inf]
    return np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] > padded[2:]))


def _local_level(gains: np.ndarray, index: int) -> float:
    """Local median of a spectrum (o) of two coefficients over that of white noise, log 2; at least 1."""
    return max(1.0, _local_median(gains, index) / float(np.log(2)))


def _local_median(spectrum: np.ndarray, index: int) -> float:
    """Median of a spectrum (o) over the neighbours of an index."""
    return float(np.median(spectrum[max(index - _NEIGHBOURS, 0) : index + _NEIGHBOURS + 1]))


def wave_slopes(bench: Workbench, base: Fit, effect: Effect, peak: Peak) -> np.ndarray:
    """Derivatives (n x k) of the residual by the coefficients of the wave at one of its `spectral_peaks`."""
    scan = _Scan.of(bench, base, peak.acts)
    if scan is None:
        return np.zeros((len(base.residual), 0))
    parts = scan.columns(np.array([peak.order]))
    slopes = np.zeros((len(base.residual), len(next(iter(parts.values())))))
    for index, columns in parts.items():
        slopes[bench.data.groups[index].rows] = columns[:, 0].T
    return slopes


@dataclass(frozen=True)
class _Scan:
    """The part of the regressions that is the same at all orders.

    Attributes:
      bench, base: the data and the fit whose residuals are regressed.
      weights: (n) of the residual.
      information, gradient: of the unknowns of the fit (p x p), (p).
      acts: kind of the wave, see `Peak.acts`.
      groups: indices of the groups of residuals that the wave changes.
      motions: recording -> its motion, of the recordings of these groups.
      columns: from orders (o) to derivatives: index of a group -> (k, o, rows).
    """

    bench: Workbench
    base: Fit
    weights: np.ndarray
    information: np.ndarray
    gradient: np.ndarray
    acts: str
    groups: tuple[int, ...]
    motions: dict[int, Motion]
    columns: Callable[[np.ndarray], Columns]

    @staticmethod
    def of(bench: Workbench, base: Fit, acts: str) -> _Scan | None:
        data = cast(DrivenData, bench.data)
        usable = [
            (k, g) for k, g in enumerate(data.groups) if g.channel not in (*EVENT_CHANNELS, "motor_torque")
        ]
        moving = {i for i, p in enumerate(data.prepared) if p.hub is not None or acts == "shake"}
        groups = [
            (k, g)
            for k, g in usable
            if g.recording in moving and (acts in _SEEN_BY_STRAINS or g.channel == HUB_TORQUE)
        ]
        motions = _followed(data, base, {g.recording for _, g in groups})
        groups = [(k, g) for k, g in groups if g.recording in motions]
        if not groups:
            return None
        views = {i: data.views[i] for i in motions}

        def columns(orders: np.ndarray) -> Columns:
            slopes: Columns = {}
            for i, motion in motions.items():
                waves = _waves(acts, orders, motion)
                changes = _changes(acts, orders, waves, motion, views[i], base.model)
                parts = {c: scaled_change(views[i], base.model, c, v) for c, v in changes.items()}
                if acts == "resonance":
                    parts = {channel: _of_oscillator(channel, part) for channel, part in parts.items()}
                for k, g in groups:
                    if g.recording == i and g.channel in parts:
                        slopes[k] = parts[g.channel] * bench.scale[g.rows]
            return slopes

        weights = row_weights(bench, base.residual)
        information, gradient = normal_equations(bench, base)
        indices = tuple(k for k, _ in groups)
        return _Scan(bench, base, weights, information, gradient, acts, indices, motions, columns)

    def at(self, orders: np.ndarray) -> list[Peak]:
        """The points of the spectrum at some orders (o)."""
        J, r, w = self.base.jacobian, self.base.residual, self.weights
        slopes = self.columns(orders)
        k, count, p = len(next(iter(slopes.values()))), len(orders), J.shape[1]
        squares, mixed, slope = np.zeros((count, k, k)), np.zeros((k, count, p)), np.zeros((k, count))
        for index, columns in slopes.items():
            rows = self.bench.data.groups[index].rows
            weighted = columns * w[rows]
            squares += weighted.transpose(1, 0, 2) @ columns.transpose(1, 2, 0)
            mixed += weighted @ J[rows]
            slope += weighted @ r[rows]
        inverse = np.linalg.pinv(self.information, hermitian=True)
        return [
            replace(
                _regression(float(order), squares[o], mixed[:, o], slope[:, o], inverse, self.gradient),
                acts=self.acts,
            )
            for o, order in enumerate(orders)
        ]


def _followed(data: DrivenData, base: Fit, recordings: Collection[int]) -> dict[int, Motion]:
    """Recording -> motion of its link under a fit; of those in which it diverges, as a fit to other data may, none."""
    motions = {
        i: move_link(data.views[i], data.prepared[i], base.model, base.starts[i])[0] for i in recordings
    }
    return {i: motion for i, motion in motions.items() if np.isfinite(motion.angles).all()}


def _regression(
    order: float,
    squares: np.ndarray,
    mixed: np.ndarray,
    slope: np.ndarray,
    inverse: np.ndarray,
    gradient: np.ndarray,
) -> Peak:
    """Least squares for the wave, the unknowns of the fit (p) eliminated by their Schur complement.

    Args:
      order: of the wave.
      squares, slope: information (k x k) and gradient (k) of its coefficients.
      mixed: (k x p) information shared with the unknowns.
      inverse, gradient: inverse information (p x p) and gradient (p) of the unknowns.
    """
    reduced = squares - mixed @ inverse @ mixed.T
    reduced_gradient = slope - mixed @ inverse @ gradient
    scale = root_diagonal(reduced)
    system, right = reduced / np.outer(scale, scale), reduced_gradient / scale
    move = -np.linalg.lstsq(system, right, rcond=1e-6)[0] / scale
    return Peak(order, tuple(move.tolist()), float(-0.5 * reduced_gradient @ move))


def _wave(effect: Effect) -> Wave:
    if effect.wave is None:
        raise ValueError(f"{effect.name} is not a wave.")
    return effect.wave


def _grid(acts: str, motions: Sequence[Motion]) -> np.ndarray:
    """Orders (o) at a distance of less than the width of a peak."""
    if acts == "resonance":
        return np.arange(_LOWEST[acts], _HIGHEST[acts], 0.25)
    if acts == "time":
        step = 0.35 / max(m.time[-1] - m.time[0] for m in motions)
        return np.arange(_LOWEST[acts], _HIGHEST[acts], step)
    widest = max(float(np.ptp(m.angles[:, 0])) for m in motions)
    low = _LOWEST[acts]  # a rotating part has at least one period a turn
    return np.arange(low, max(_HIGHEST[acts], 2 * low), max(1.0 / max(widest, 1e-3), _SMALLEST_STEP))


def _waves(acts: str, orders: np.ndarray, motion: Motion) -> np.ndarray:
    """Sine and cosine (k, o, m) of each order, as a function of the variable on which the wave depends.

    Of a friction level they are multiplied by the direction, with a constant as third column. Of a resonance, it is the
    angle (1, o, m) of an oscillator of this frequency against the hub.
    """
    if acts == "resonance":
        push = -np.gradient(motion.rates[:, 0], motion.time)
        return np.stack(
            [[lfilter(*_discretised_oscillator(2 * np.pi * f, RESONANCE_DAMPING), push) for f in orders]]
        )
    x = 2 * np.pi * (motion.time - motion.time[0]) if acts in ("time", "shake") else motion.angles[:, 0]
    angle = orders[:, None] * x
    waves = np.stack([np.sin(angle), np.cos(angle)])
    if acts == "friction":
        return -0.5 * motion.modes * np.concatenate([waves, np.ones((1, *angle.shape))])
    return waves


def _changes(
    acts: str, orders: np.ndarray, waves: np.ndarray, motion: Motion, view: View, model: Model
) -> dict[str, np.ndarray]:
    """Channel -> (k, o, m) derivative of the raw residual by the coefficients of the waves, low-passed.

    The torque balance counts as measured, by the measured motion; a strain is simulated: their signs differ.
    """
    if acts == "reading":
        # The error of the sensor is a motion of the modelled link that the rig did not make.
        acceleration = _second_derivative(low_passed(waves, GRID, view.band))
        balance, simulated = -1.0, _response_to_hub(model, acceleration)
    elif acts == "shake":
        balance, simulated = 1.0, _response_to_base(model, waves, motion)
    elif acts == "resonance":
        balance, simulated = 1.0, _response_to_oscillator(model, waves)
    elif acts == "friction":
        balance, simulated = -1.0, {HUB_TORQUE: low_passed(waves, GRID, view.band)}
    else:
        balance, simulated = -1.0, {HUB_TORQUE: waves}
    if acts == "time":
        filtered = {HUB_TORQUE: low_pass_gain(orders, GRID)[:, None] * simulated[HUB_TORQUE]}
    else:
        filtered = {channel: low_passed(values, GRID) for channel, values in simulated.items()}
    signs = {channel: balance if channel == HUB_TORQUE else -balance for channel in filtered}
    return {c: signs[c] * values for c, values in filtered.items() if c in view.noise}


def _response_to_oscillator(model: Model, angles: np.ndarray) -> dict[str, np.ndarray]:
    """Channel -> response (..., m) to an oscillator of angle (..., m) against the hub [rad], by its own coefficient."""
    strains = {c: angles for c in _COEFFICIENTS[1:] if c in model.curvature_rows}
    return {HUB_TORQUE: model.plant.hub_inertia * _second_derivative(angles), **strains}


def _of_oscillator(channel: str, response: np.ndarray) -> np.ndarray:
    """Derivatives (3, o, m) of a channel by inertia share and sensitivities, given that by its own (1, o, m)."""
    return np.eye(len(_COEFFICIENTS))[_COEFFICIENTS.index(channel), :, None, None] * response


def _second_derivative(values: np.ndarray) -> np.ndarray:
    """Second derivative (..., m) in time, on the uniform grid."""
    return np.gradient(np.gradient(values, GRID, axis=-1), GRID, axis=-1)


def _response_to_hub(model: Model, acceleration: np.ndarray) -> dict[str, np.ndarray]:
    """Torque on the hub and readings of the link (k, o, m) for small accelerations of the hub (k, o, m) [rad/s^2]."""
    return _clamped_response(model, acceleration, model.chain.mass_matrix()[0][None, :, None])


def _response_to_base(model: Model, acceleration: np.ndarray, motion: Motion) -> dict[str, np.ndarray]:
    """Torque on the hub and readings of the link (2 k, o, m) for accelerations of the base along x, then along y.

    A segment at the angle phi feels the component across it: -sin(phi) of x, cos(phi) of y.

    Args:
      model: of the rig.
      acceleration: (k, o, m) [m/s^2].
      motion: of the link (m).
    """
    across = np.stack([-np.sin(motion.angles.T), np.cos(motion.angles.T)])
    on_segments = model.chain.first_moment[:, None] * across
    return _clamped_response(model, acceleration, np.cumsum(on_segments[:, ::-1], axis=1)[:, ::-1])


def _clamped_response(model: Model, acceleration: np.ndarray, load: np.ndarray) -> dict[str, np.ndarray]:
    """Torque that holds the hub and readings of the link (d k, o, m), by clamped modes, under accelerations a.

    q'' + 2 zeta omega q' + omega^2 q = -p a and torque = p_0 a + sum g q'', where p is the inertial load on hub and
    hinges for a unit acceleration, and g is the row of the hub in the mass matrix; both in modal coordinates.

    Args:
      model: of the rig.
      acceleration: a (k, o, m), the same in each direction.
      load: p (d, n + 1, m) of each direction, by coordinates of the chain, hub first; (d, n + 1, 1) if constant.
    """

    def inertial(weights: np.ndarray) -> np.ndarray:
        return np.concatenate([acceleration * weight for weight in weights])

    mass = model.chain.mass_matrix()
    frequencies, shapes = model.chain.modes("clamped")
    ratios = model.chain.damping_ratios("clamped")
    torque = inertial(load[:, 0])
    readings = {c: np.zeros_like(torque) for c in model.link_rows}
    seen = frequencies < 2 * np.pi * BAND
    for omega, zeta, shape in zip(frequencies[seen], ratios[seen], shapes[1:, seen].T, strict=True):
        force = -inertial(np.tensordot(load[:, 1:], shape, (1, 0)))
        q = lfilter(*_discretised_oscillator(float(omega), float(zeta)), force)
        torque = torque + float(mass[0, 1:] @ shape) * _second_derivative(q)
        for channel, row in model.link_rows.items():
            readings[channel] += float(row @ shape) * q
    return {HUB_TORQUE: torque, **readings}


@functools.lru_cache(maxsize=1024)
def _discretised_oscillator(omega: float, zeta: float) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of 1/(s^2 + 2 zeta omega s + omega^2), discretised on the grid, first-order hold."""
    system = (np.array([1.0]), np.array([1.0, 2 * zeta * omega, omega**2]))
    numerator, denominator, _ = cont2discrete(system, GRID, method="foh")
    return np.ravel(numerator), denominator
