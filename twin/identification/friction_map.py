"""Coulomb friction the paper's way: from how fast a free vibration of the unclamped rig dies away.

Friction at the hub takes energy from the vibration: the decay has an equivalent damping ratio, larger the larger
tau_c is. Simulations of the same release for growing tau_c give the map from tau_c to it, and its inverse gives tau_c
(Bossi et al. 2009, section on the identification of the friction).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import toeplitz
from scipy.signal import butter, find_peaks, sosfiltfilt

from twin.identification import decay
from twin.identification.estimates import Estimate, grown
from twin.mechanics.state import Start
from twin.recording import Recording
from twin.residuals.prepared import Prepared, sensor_corrected_start
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

_LEAST_SWINGS = 4
_BAND = 1.5  # corner of a low-pass, in parts of the free frequency
_APART = 0.6  # of half a period, between two extremes at least
_ODD = 0.3  # relative distance of a swing's duration from half a period, from which it is another vibration's
_SEEN = 20.0  # noise levels above which a swing counts
_LEVELS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5])
"""Coulomb frictions that are tried, in parts of the model's."""
_CLOSER = np.array([0.94, 1.0, 1.06])
"""The same, in parts of what they gave."""
_ROUNDS = 4  # in which simulated swings are made as large as the measured ones
_AS_LARGE = 1e-3  # relative difference up to which they are


@dataclass(frozen=True)
class FrictionMap:
    """The map and where the measurement lies on it.

    Attributes:
      recording: of the release.
      coulomb: (n) levels that were simulated [N m].
      damping: (n) equivalent damping ratios of their decays [1].
      measured: equivalent damping ratio of the measured decay.
      level: Coulomb friction; None where the map does not rise through the measured ratio.
      deflection: of the tip at the release, by the size of the swings; as declared where there is no level [m].
    """

    recording: str
    coulomb: np.ndarray
    damping: np.ndarray
    measured: Estimate
    level: Estimate | None
    deflection: float


def with_error_of(found: FrictionMap, other: FrictionMap) -> FrictionMap:
    """The map, the error of its level grown by that of something else that it takes as known.

    What the link loses more, friction takes less: 1 % of a damping ratio of 0.034 is 0.6 to 0.9 % of 0.0055 N m.

    Args:
      found: the map.
      other: the same with that one standard error larger.
    """
    if found.level is None or other.level is None:
        return found
    return replace(found, level=grown(found.level, other.level))


def read(model: Model, prepared: Sequence[Prepared], starts: Sequence[Start]) -> FrictionMap | None:
    """The map of the first recording of an unclamped rig whose tip is drawn aside and released; None without one.

    Args:
      model: the identified rig; of its friction only the static level counts.
      prepared: recordings.
      starts: states at their first samples.
    """
    for p, start in zip(prepared, starts, strict=True):
        recording = p.recording
        channel = decay.link_channel(recording)
        if recording.clamped or recording.initial_tip_deflection is None or channel is None:
            continue
        frequency = float(model.chain.modes("free")[0][0]) / (2 * math.pi)
        found = _read(model, p, start, channel, frequency)
        if found is not None:
            return found
    return None


def _read(
    model: Model, prepared: Prepared, start: Start, channel: str, frequency: float
) -> FrictionMap | None:
    """The map of one release; None where it swings too seldom."""
    recording, noise = prepared.recording, prepared.noise.get(channel, 0.0)
    swings, deflection = _swings(recording, channel, frequency, noise), recording.initial_tip_deflection
    assert deflection is not None

    @functools.cache
    def simulated(level: float, deflection: float) -> np.ndarray:
        return _swings(_released(model, prepared, start, level, deflection), channel, frequency, noise)

    def damping(count: int, level: float) -> float:
        _, run = _as_large(functools.partial(simulated, level), swings[:count], deflection)
        return _equivalent(run).value if len(run) == count else math.nan

    found = None
    # The last swing may be cut short by a hub that sticks on its way; a little more friction takes the one before too.
    for count in range(len(swings) - 1, _LEAST_SWINGS - 1, -1):
        scatter = _scatter(count, recording.period, frequency, noise)
        measured = _equivalent(swings[:count], scatter)
        known = _mapped(functools.partial(damping, count), model.declared["coulomb_friction"] * _LEVELS)
        rough = _inverse(*known, measured)
        if rough is not None:
            known = _mapped(functools.partial(damping, count), rough.value * _CLOSER, known)
        level = _inverse(*known, measured)
        found = FrictionMap(recording.name, *known, measured, level, deflection)
        if level is not None:
            level = _with_size(level, measured, swings[:count], scatter)
            size, _ = _as_large(functools.partial(simulated, level.value), swings[:count], deflection)
            return replace(found, level=level, deflection=size)
    return found


def _as_large(
    simulated: Callable[[float], np.ndarray], swings: np.ndarray, deflection: float
) -> tuple[float, np.ndarray]:
    """The deflection [m] from which simulated swings are as large as those measured (n), and these swings.

    It is near the one that is declared, `deflection`.

    A ruler is read to a millimetre, the gauge says better how far the tip was drawn aside; and a given friction takes
    the larger a part of a swing the smaller it is.
    """
    run = simulated(deflection)[: len(swings)]
    for _ in range(_ROUNDS):
        if len(run) < _LEAST_SWINGS:
            break
        ratio = math.exp(float(np.log(swings[: len(run)] / run).mean()))
        if abs(ratio - 1) < _AS_LARGE:
            break
        deflection *= ratio
        run = simulated(deflection)[: len(swings)]
    return deflection, run


def _with_size(level: Estimate, measured: Estimate, swings: np.ndarray, scatter: np.ndarray) -> Estimate:
    """The level, its error with that of the size of the swings (n): friction goes in proportion to it."""
    x = _centred(len(swings))
    slope = measured.standard_error / level.standard_error if level.standard_error > 0 else math.inf
    pulls = -x / (x @ x) / math.pi / slope + level.value / len(swings)
    pulls = pulls / swings
    return replace(level, standard_error=math.sqrt(float(pulls @ scatter @ pulls)))


def _mapped(
    damping: Callable[[float], float], levels: np.ndarray, known: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Levels (n) in order and their equivalent damping (n), beside those that are known; none where the hub sticks."""
    x, y = levels, np.array([damping(float(level)) for level in levels])
    if known is not None:
        x, y = np.r_[known[0], x], np.r_[known[1], y]
    x, first = np.unique(x, return_index=True)
    y = y[first]
    return x[np.isfinite(y)], y[np.isfinite(y)]


def _swings(recording: Recording, channel: str, frequency: float, noise: float) -> np.ndarray:
    """Sizes (n) of the first swings of the link, while their period is that of the free link.

    A hub that sticks makes them longer: from there on it is another vibration.
    """
    known = np.isfinite(recording[channel])
    time, values = recording.time[known], recording[channel][known]
    period = float(np.median(np.diff(time)))
    half = 0.5 / frequency / period
    # The release rings in higher modes too.
    smooth = sosfiltfilt(_low_pass(frequency, period), values)
    tops = np.sort(
        np.r_[find_peaks(smooth, distance=_APART * half)[0], find_peaks(-smooth, distance=_APART * half)[0]]
    )
    swings = np.abs(np.diff(smooth[tops]))
    odd = (np.abs(np.diff(tops) / half - 1) > _ODD) | (swings < _SEEN * noise)
    return swings[: int(np.argmax(odd)) if odd.any() else len(swings)]


def _low_pass(frequency: float, period: float) -> np.ndarray:
    """Sections of the low-pass through which the swings of a free frequency [Hz] are seen."""
    return butter(3, _BAND * frequency, fs=1 / period, output="sos")


def _scatter(count: int, period: float, frequency: float, noise: float) -> np.ndarray:
    """Covariance (count x count) of swings by a sensor's white noise behind the low-pass.

    A swing has both its ends from the noise of the sensor, and shares one with the next: where an end is too far
    out, both are too large.
    """
    half = 0.5 / frequency / period
    impulse = np.zeros(2 * int(10 * half) + 1)
    impulse[len(impulse) // 2] = 1.0
    response = sosfiltfilt(_low_pass(frequency, period), impulse)
    lags = np.round(half * np.arange(count + 1)).astype(int)
    alike = [response[: len(response) - k] @ response[k:] if k < len(response) else 0.0 for k in lags]
    outwards = (-1.0) ** np.arange(count + 1)
    ends = toeplitz(alike) * np.outer(outwards, outwards)
    return noise**2 * (ends[:-1, :-1] + ends[:-1, 1:] + ends[1:, :-1] + ends[1:, 1:])


def _equivalent(swings: np.ndarray, scatter: np.ndarray | None = None) -> Estimate:
    """Equivalent damping ratio of swings (n) by their logarithmic decrement; `scatter` is their covariance (n x n).

    A swing is half a period: ln(a_k/a_k+1) = pi zeta/sqrt(1 - zeta^2). That friction bends the line is no error: it
    bends the simulated one as much.
    """
    x = _centred(len(swings))
    slope = float(x @ np.log(swings) / (x @ x))
    pulls = x / swings / (x @ x)
    error = 0.0 if scatter is None else math.sqrt(float(pulls @ scatter @ pulls))
    return Estimate(-slope / math.pi, error / math.pi)


def _centred(count: int) -> np.ndarray:
    """Indices of swings (count) about the middle one."""
    return np.arange(count) - (count - 1) / 2


def _released(model: Model, prepared: Prepared, start: Start, level: float, deflection: float) -> Recording:
    """The release from this deflection [m], simulated with this Coulomb friction [N m]."""
    tried = model.replace(declared=model.declared.replace("tried", coulomb_friction=level))
    recording = prepared.recording.replace(initial_tip_deflection=deflection)
    return simulate(tried, recording, sensor_corrected_start(tried, prepared, start))


def _inverse(levels: np.ndarray, damping: np.ndarray, measured: Estimate) -> Estimate | None:
    """The level at which the map crosses the measured ratio; its error by the map's slope there."""
    rising = np.diff(damping) > 0
    crossing = (damping[:-1] <= measured.value) & (measured.value < damping[1:])
    if not rising.all() or not crossing.any():
        return None
    k = int(np.argmax(crossing))
    slope = (damping[k + 1] - damping[k]) / (levels[k + 1] - levels[k])
    level = levels[k] + (measured.value - damping[k]) / slope
    return Estimate(float(level), float(measured.standard_error / slope))
