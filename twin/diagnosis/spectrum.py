"""Orders and phases of effects that repeat with the angle or with time, from the spectrum of what is unexplained.

At neutral the order of a wave has no slope. For each order of a grid the residual is regressed on sine and cosine,
the declared parameters free to give way; where the gain peaks, a fit can start.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy.fft import next_fast_len, rfft, rfftfreq
from scipy.signal import cont2discrete, lfilter

from twin.effects.base import Effect
from twin.effects.wave import RESONANCE_DAMPING, Wave
from twin.estimation.fit import Fit
from twin.estimation.slopes import normal_equations, row_weights
from twin.estimation.workbench import Workbench
from twin.mechanics.state import Motion
from twin.residuals.data import EVENT_CHANNELS, DrivenData
from twin.residuals.filters import GRID, low_pass_gain, low_passed
from twin.residuals.view import View, move_link, whitened
from twin.rigs.model import Model

_PEAKS = 3
_LOUDEST = 3  # frequencies at which a base is tried that shakes
_ABOUT = 60  # frequencies to either side that tell how loud the noise is about one
_AT_ONCE = 16  # orders of one piece of work
_MODES = 3
_FINEST = 0.05  # smallest step of an order
_ON_LINK = ("reading", "resonance", "shake")  # what strains tell, too
_HIGHEST = {"torque": 60.0, "friction": 60.0, "reading": 30.0, "time": 30.0, "resonance": 55.0}
_LOWEST = {"torque": 1.0, "friction": 1.0, "reading": 1.0, "time": 0.1, "resonance": 5.0}

Columns = dict[int, np.ndarray]
"""Index of a group -> (k, orders, rows) slopes of its residual."""


@dataclass(frozen=True)
class Peak:
    """A place in the spectrum.

    Attributes:
      order: of the wave, per radian; of a wave in time or a resonance its frequency [Hz].
      coefficients: (k) by regression.
      gain: drop of half the weighted squares.
      rivals: number of peaks in the spectrum, this one among them.
      level: how high the spectrum over time is about this place, in that of white noise; 1 of any other spectrum.
      acts: as what: see `Wave`, or "shake", an acceleration of the base.
    """

    order: float
    coefficients: tuple[float, ...]
    gain: float
    rivals: int = 1
    level: float = 1.0
    acts: str = ""


def spectral_peaks(bench: Workbench, base: Fit, effect: Effect) -> tuple[Peak, ...]:
    """The highest peaks of the spectrum, best first."""
    scan = _Scan.of(bench, base, _wave(effect).acts)
    if scan is None:
        return ()
    orders = _grid(scan.acts, list(scan.motions.values()))
    chunks = np.array_split(orders, max(1, len(orders) // _AT_ONCE))
    found = [peak for some in bench.pool.map(scan.at, chunks) for peak in some]
    gains = np.array([peak.gain for peak in found])
    tops = _tops(gains)
    best = tops[np.argsort(-gains[tops])[:_PEAKS]]
    in_time = scan.acts == "time"
    highest = [
        replace(found[k], rivals=len(tops), level=_level(gains, k) if in_time else 1.0)
        for k in best
        if found[k].gain > 0
    ]
    shaken = _shaken(bench, base, orders) if in_time else []
    # By chance a coefficient gains a half.
    return tuple(sorted([*highest, *shaken], key=lambda peak: -peak.gain + 0.5 * len(peak.coefficients)))


def _shaken(bench: Workbench, base: Fit, frequencies: np.ndarray) -> list[Peak]:
    """The best frequency for an acceleration of the base along x and y, among those at which most is unexplained."""
    scan = _Scan.of(bench, base, "shake")
    if scan is None:
        return []
    loud = _loudness(scan, frequencies)
    tops = _tops(loud)
    about = np.array([_usual(loud, k) for k in tops])
    chosen = np.argsort(-loud[tops] / about)[:_LOUDEST]
    peaks = scan.at(frequencies[tops[chosen]])
    best = int(np.argmax([peak.gain for peak in peaks]))
    if peaks[best].gain <= 0:
        return []
    return [replace(peaks[best], rivals=len(tops), level=max(1.0, float(about[chosen[best]])))]


def _loudness(scan: _Scan, frequencies: np.ndarray) -> np.ndarray:
    """Power of what is unexplained (f) at evenly spaced frequencies [Hz], in that of most of them."""
    size = next_fast_len(round(1 / ((frequencies[1] - frequencies[0]) * GRID)))
    total = np.zeros(len(frequencies))
    for group in (scan.bench.data.groups[k] for k in scan.groups):
        signal = scan.base.residual[group.rows] * np.sqrt(scan.weights[group.rows])
        length = max(size, len(signal))
        power = np.abs(rfft(signal, length)) ** 2
        total += np.interp(frequencies, rfftfreq(length, GRID), power) / max(float(power.mean()), 1e-300)
    return total / np.median(total)


def _tops(spectrum: np.ndarray) -> np.ndarray:
    """Indices of the peaks of a spectrum (o), its ends among them."""
    inner = np.r_[-np.inf, spectrum, -np.inf]
    return np.flatnonzero((inner[1:-1] >= inner[:-2]) & (inner[1:-1] > inner[2:]))


def _level(gains: np.ndarray, place: int) -> float:
    """Median of a spectrum (o) of sine and cosine about a place, over that of white noise; at least 1."""
    return max(1.0, _usual(gains, place) / float(np.log(2)))


def _usual(spectrum: np.ndarray, place: int) -> float:
    """Median of a spectrum (o) about a place."""
    return float(np.median(spectrum[max(place - _ABOUT, 0) : place + _ABOUT + 1]))


def wave_slopes(bench: Workbench, base: Fit, effect: Effect, peak: Peak) -> np.ndarray:
    """Slopes (n x k) of the residual for the wave at one of its `spectral_peaks`, for `fit.slope_gain`."""
    scan = _Scan.of(bench, base, peak.acts)
    if scan is None:
        return np.zeros((len(base.residual), 0))
    parts = scan.columns(np.array([peak.order]))
    found = np.zeros((len(base.residual), len(next(iter(parts.values())))))
    for index, columns in parts.items():
        found[bench.data.groups[index].rows] = columns[:, 0].T
    return found


@dataclass(frozen=True)
class _Scan:
    """The base's part of the regressions, computed once.

    Attributes:
      bench, base: the fit to look beyond.
      weights: (n) of the residual.
      information, gradient: of the base's unknowns (p x p), (p).
      acts: see `Peak`.
      groups: indices of those that are told anything.
      motions: recording -> motion of those.
      columns: orders (o) to slopes: index of a group -> (k, o, rows).
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
        seen = [
            (k, g) for k, g in enumerate(data.groups) if g.channel not in (*EVENT_CHANNELS, "motor_torque")
        ]
        free = {i for i, p in enumerate(data.prepared) if p.hub is not None or acts == "shake"}
        groups = [
            (k, g) for k, g in seen if g.recording in free and (acts in _ON_LINK or g.channel == "hub_torque")
        ]
        if not groups:
            return None
        motions = {
            i: move_link(data.views[i], data.prepared[i], base.model, base.starts[i])[0]
            for i in {g.recording for _, g in groups}
        }
        views = {i: data.views[i] for i in motions}

        def columns(orders: np.ndarray) -> Columns:
            found: Columns = {}
            for i, motion in motions.items():
                waves = _waves(acts, orders, motion)
                parts = _responses(acts, orders, waves, views[i], base.model)
                for k, g in groups:
                    if g.recording == i and g.channel in parts:
                        found[k] = (
                            parts[g.channel] * bench.weight[g.rows] / views[i].noise_scale.get(g.channel, 1.0)
                        )
            return found

        weights = row_weights(bench, base.residual)
        information, gradient = normal_equations(bench, base)
        told = tuple(k for k, _ in groups)
        return _Scan(bench, base, weights, information, gradient, acts, told, motions, columns)

    def at(self, orders: np.ndarray) -> list[Peak]:
        """The regressions at some orders (o)."""
        J, r, w = self.base.jacobian, self.base.residual, self.weights
        found = self.columns(orders)
        k, count, p = len(next(iter(found.values()))), len(orders), J.shape[1]
        squares, mixed, slope = np.zeros((count, k, k)), np.zeros((k, count, p)), np.zeros((k, count))
        for index, columns in found.items():
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


def _regression(
    order: float,
    squares: np.ndarray,
    mixed: np.ndarray,
    slope: np.ndarray,
    inverse: np.ndarray,
    gradient: np.ndarray,
) -> Peak:
    """The wave's normal equations with the base's unknowns (p) eliminated, solved."""
    left = squares - mixed @ inverse @ mixed.T
    pull = slope - mixed @ inverse @ gradient
    scale = np.sqrt(np.maximum(np.diag(left), 1e-300))
    move = -np.linalg.lstsq(left / np.outer(scale, scale), pull / scale, rcond=1e-6)[0] / scale
    return Peak(order, tuple(move.tolist()), float(-0.5 * pull @ move))


def _wave(effect: Effect) -> Wave:
    if effect.wave is None:
        raise ValueError(f"{effect.name} is not a wave.")
    return effect.wave


def _grid(acts: str, motions: Sequence[Motion]) -> np.ndarray:
    """Orders close enough that no peak falls between two."""
    if acts == "resonance":
        return np.arange(_LOWEST[acts], _HIGHEST[acts], 0.25)
    if acts == "time":
        step = 0.35 / max(m.time[-1] - m.time[0] for m in motions)
        return np.arange(_LOWEST[acts], _HIGHEST[acts], step)
    widest = max(float(np.ptp(m.angles[:, 0])) for m in motions)
    low = _LOWEST[acts]  # what repeats with a turning part does so at least once a turn
    return np.arange(low, max(_HIGHEST[acts], 2 * low), max(1.0 / max(widest, 1e-3), _FINEST))


def _waves(acts: str, orders: np.ndarray, motion: Motion) -> np.ndarray:
    """Sine and cosine (k, o, m) of the orders, as they act; of a level of friction its mean as well.

    Of a resonance, the angle (1, o, m) against the hub.
    """
    if acts == "resonance":
        push = -np.gradient(motion.rates[:, 0], motion.time)
        return np.stack([[lfilter(*_sampled(2 * np.pi * f, RESONANCE_DAMPING), push) for f in orders]])
    x = 2 * np.pi * motion.time if acts in ("time", "shake") else motion.angles[:, 0]
    angle = orders[:, None] * x
    waves = np.stack([np.sin(angle), np.cos(angle)])
    if acts == "shake":
        # Along x and along y, as the link feels it across.
        across = -np.sin(motion.angles[:, 0]), np.cos(motion.angles[:, 0])
        return np.concatenate([waves * across[0], waves * across[1]])
    if acts == "friction":
        return -0.5 * motion.modes * np.concatenate([waves, np.ones((1, *angle.shape))])
    return waves


def _responses(
    acts: str, orders: np.ndarray, waves: np.ndarray, view: View, model: Model
) -> dict[str, np.ndarray]:
    """Channel -> (k, o, m) change of the residual, noise units."""
    if acts == "time":
        share = low_pass_gain(orders, GRID)[:, None]
        return {"hub_torque": -share * waves / view.noise["hub_torque"]}
    if acts == "resonance":
        return _resonances(waves[0], view, model)
    if acts == "shake":
        return _changes(_under_base(model, waves), view, 1.0)
    if acts != "reading":
        return {"hub_torque": -low_passed(waves, GRID) / view.noise["hub_torque"]}
    # What the sensor's error lets the hub seem to do was never there.
    return _changes(_under_hub(model, _second(low_passed(waves, GRID, view.band))), view, -1.0)


def _changes(responses: dict[str, np.ndarray], view: View, size: float) -> dict[str, np.ndarray]:
    """Channel -> (..., m) change of the residual, noise units, if so much of this is there: measured less simulated.

    A torque that the motion takes is measured, a strain simulated.
    """
    return {
        channel: whitened(
            (size if channel == "hub_torque" else -size) * low_passed(response, GRID), view, channel
        )
        for channel, response in responses.items()
        if channel in view.noise
    }


def _resonances(angles: np.ndarray, view: View, model: Model) -> dict[str, np.ndarray]:
    """Channel -> (3, o, m): what a share of the hub's inertia that swings (o, m) takes, and what the bridges see."""
    found = {}
    seen = ("hub_torque", "strain_base", "strain_mid")
    for channel in {"hub_torque", *model.curvature_rows} & {"hub_torque", *view.measured}:
        columns = np.zeros((len(seen), *angles.shape))
        if channel == "hub_torque":
            swing = model.plant.hub_inertia * _second(angles)
            columns[0] = low_passed(swing, GRID) / view.noise["hub_torque"]
        else:
            filtered = low_passed(angles, GRID)
            columns[seen.index(channel)] = -whitened(filtered, view, channel)
        found[channel] = columns
    return found


def _second(values: np.ndarray) -> np.ndarray:
    """Second derivative (..., m) on the grid."""
    return np.gradient(np.gradient(values, GRID, axis=-1), GRID, axis=-1)


def _under_hub(model: Model, acceleration: np.ndarray) -> dict[str, np.ndarray]:
    """Torque on the hub and strains (..., m) that small hub accelerations (..., m) [rad/s^2] take."""
    return _under(model, acceleration, model.chain.mass_matrix()[0])


def _under_base(model: Model, acceleration: np.ndarray) -> dict[str, np.ndarray]:
    """Torque on the hub and strains (..., m) that accelerations (..., m) of the base across the link [m/s^2] take."""
    return _under(model, acceleration, np.cumsum(model.chain.first_moment[::-1])[::-1])


def _under(model: Model, acceleration: np.ndarray, pulled: np.ndarray) -> dict[str, np.ndarray]:
    """Torque on the hub and strains (..., m) that hold a hub where an acceleration (..., m) pulls at its coordinates.

    In clamped modes q'' + 2 zeta omega q' + omega^2 q = -p a, and the torque is p_0 a + sum g q'', with p what an
    acceleration pulls (n + 1), on the hub and each hinge behind it.
    """
    mass = model.chain.mass_matrix()
    frequencies, shapes = model.chain.modes("clamped")
    ratios = model.chain.damping_ratios("clamped")
    torque = pulled[0] * acceleration
    strains = {c: np.zeros_like(acceleration) for c in model.curvature_rows}
    for omega, zeta, shape in list(zip(frequencies, ratios, shapes[1:].T, strict=True))[:_MODES]:
        q = lfilter(*_sampled(float(omega), float(zeta)), -float(pulled[1:] @ shape) * acceleration)
        torque = torque + float(mass[0, 1:] @ shape) * _second(q)
        for channel, row in model.curvature_rows.items():
            strains[channel] += model.sensors[channel].half_thickness * float(row @ shape) * q
    return {"hub_torque": torque, **strains}


@functools.lru_cache(maxsize=1024)
def _sampled(omega: float, zeta: float) -> tuple[np.ndarray, np.ndarray]:
    """1/(s^2 + 2 zeta omega s + omega^2) on the grid, its input linear in between."""
    system = (np.array([1.0]), np.array([1.0, 2 * zeta * omega, omega**2]))
    numerator, denominator, _ = cont2discrete(system, GRID, method="foh")
    return np.ravel(numerator), denominator
