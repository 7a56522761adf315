"""Coulomb friction from the decay of the free vibration of the unclamped rig, by the procedure of Bossi et al. 2009.

Hub friction dissipates energy: the equivalent damping ratio of the decay grows with the Coulomb level tau_c.
Simulations of the same release for several tau_c give the map from tau_c to the damping ratio; its inverse at the
measured ratio gives tau_c (section on the identification of the friction).

A swing is the peak-to-peak amplitude of half a period.
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
from twin.identification.estimates import Estimate, with_nuisance_error
from twin.mechanics.state import Start
from twin.recording import Recording, sample_period
from twin.residuals.prepared import Prepared, sensor_corrected_start
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

_MIN_SWINGS = 4  # swings that a decay needs, without the last one
_BAND = 1.5  # corner of the low-pass over the first free frequency [1]: it removes the higher modes
_MIN_SPACING = 0.6  # least distance of two extremes, in half periods
_MAX_DURATION_ERROR = 0.3
"""Relative deviation of a swing's duration from half a period, above which the hub sticks [1]."""
_MIN_SWING = 20.0  # smallest swing that is used, in standard deviations of the sensor noise
_COARSE_GRID = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5])
"""Coulomb levels of the first simulations, over the level of the model [1]."""
_FINE_GRID = np.array([0.94, 1.0, 1.06])
"""Coulomb levels of the second simulations, over the result of the first [1]."""
_MAX_ITERATIONS = 4  # of the search for the deflection at the release
_SIZE_TOLERANCE = 1e-3  # relative difference of measured and simulated swings at which that search ends [1]


@dataclass(frozen=True)
class FrictionMap:
    """Map from Coulomb level to equivalent damping ratio, and its inverse at the measured ratio.

    Attributes:
      recording: of the release.
      coulomb: (n) simulated Coulomb levels [N m].
      damping: (n) equivalent damping ratios of the simulated decays [1].
      measured: equivalent damping ratio of the measured decay [1].
      level: Coulomb friction [N m]; None where the map does not rise through the measured ratio.
      deflection: of the tip at the release, by the size of the swings; as declared where there is no level [m].
    """

    recording: str
    coulomb: np.ndarray
    damping: np.ndarray
    measured: Estimate
    level: Estimate | None
    deflection: float


def with_map_nuisance_error(result: FrictionMap, perturbed: FrictionMap) -> FrictionMap:
    """Returns the map, the error of its level increased by that of a nuisance parameter.

    Link damping and friction share the measured losses: 1 % of a damping ratio of 0.034 is 0.6 to 0.9 % of 0.0055 N m.

    Args:
      result: with the nuisance parameter at its estimate.
      perturbed: with the nuisance parameter one standard error larger.
    """
    if result.level is None or perturbed.level is None:
        return result
    return replace(result, level=with_nuisance_error(result.level, perturbed.level))


def friction_map_of_release(
    model: Model, prepared: Sequence[Prepared], starts: Sequence[Start]
) -> FrictionMap | None:
    """Returns the map of the first recording of a released tip with a free hub; None without one.

    Args:
      model: the identified rig; of its friction the static level counts, the Coulomb level only scales the map.
      prepared: recordings.
      starts: states at their first samples.
    """
    for p, start in zip(prepared, starts, strict=True):
        recording = p.recording
        channel = decay.link_channel(recording)
        if recording.clamped or recording.initial_tip_deflection is None or channel is None:
            continue
        frequency = float(model.chain.modes("free")[0][0]) / (2 * math.pi)
        result = _map_of_recording(model, p, start, channel, frequency)
        if result is not None:
            return result
    return None


def _map_of_recording(
    model: Model, prepared: Prepared, start: Start, channel: str, frequency: float
) -> FrictionMap | None:
    """The map of one release; None with fewer than `_MIN_SWINGS` + 1 swings.

    The last swing is left out, because the hub may stick before its end; with more friction in the simulation the one
    before it may end early too, so fewer swings are tried until the map can be inverted.
    """
    recording, noise = prepared.recording, prepared.noise.get(channel, 0.0)
    swings, deflection = _swings(recording, channel, frequency, noise), recording.initial_tip_deflection
    assert deflection is not None

    @functools.cache
    def simulated(level: float, deflection: float) -> np.ndarray:
        return _swings(
            _simulate_release(model, prepared, start, level, deflection), channel, frequency, noise
        )

    def damping(count: int, level: float) -> float:
        _, run = _match_size(functools.partial(simulated, level), swings[:count], deflection)
        return _equivalent_damping(run).value if len(run) == count else math.nan

    result = None
    for count in range(len(swings) - 1, _MIN_SWINGS - 1, -1):
        scatter = _swing_covariance(count, recording.period, frequency, noise)
        measured = _equivalent_damping(swings[:count], scatter)
        known = _extend_map(
            functools.partial(damping, count), model.declared["coulomb_friction"] * _COARSE_GRID
        )
        rough = _invert_map(*known, measured)
        if rough is not None:
            known = _extend_map(functools.partial(damping, count), rough.value * _FINE_GRID, known)
        level = _invert_map(*known, measured)
        result = FrictionMap(recording.name, *known, measured, level, deflection)
        if level is not None:
            level = _with_swing_noise(level, measured, swings[:count], scatter)
            size, _ = _match_size(functools.partial(simulated, level.value), swings[:count], deflection)
            return replace(result, level=level, deflection=size)
    return result


def _match_size(
    simulated: Callable[[float], np.ndarray], swings: np.ndarray, deflection: float
) -> tuple[float, np.ndarray]:
    """Finds the release deflection [m] for which simulated swings are as large as measured; returns it and the swings.

    Friction removes a larger share of a smaller swing, so that the sizes have to match. A ruler is read to a
    millimetre; the gauge gives the deflection more accurately.

    Args:
      simulated: swings of a release from a deflection [m].
      swings: measured ones (n).
      deflection: declared one, from which the search starts [m].
    """
    run = simulated(deflection)[: len(swings)]
    for _ in range(_MAX_ITERATIONS):
        if len(run) < _MIN_SWINGS:
            break
        ratio = math.exp(float(np.log(swings[: len(run)] / run).mean()))
        if abs(ratio - 1) < _SIZE_TOLERANCE:
            break
        deflection *= ratio
        run = simulated(deflection)[: len(swings)]
    return deflection, run


def _with_swing_noise(
    level: Estimate, measured: Estimate, swings: np.ndarray, scatter: np.ndarray
) -> Estimate:
    """The level with the error by the noise of the swings (n), through their decrement and their size.

    The level is proportional to the size, for a given damping ratio; `scatter` is the covariance of the swings (n x n).
    """
    x = _centred_indices(len(swings))
    slope = measured.standard_error / level.standard_error if level.standard_error > 0 else math.inf
    weights = -x / (x @ x) / math.pi / slope + level.value / len(swings)
    weights = weights / swings
    return replace(level, standard_error=math.sqrt(float(weights @ scatter @ weights)))


def _extend_map(
    damping: Callable[[float], float], levels: np.ndarray, known: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Simulates levels and adds them to a map: levels (n) in order and damping (n), where the hub does not stick."""
    x, y = levels, np.array([damping(float(level)) for level in levels])
    if known is not None:
        x, y = np.r_[known[0], x], np.r_[known[1], y]
    x, first = np.unique(x, return_index=True)
    y = y[first]
    return x[np.isfinite(y)], y[np.isfinite(y)]


def _swings(recording: Recording, channel: str, frequency: float, noise: float) -> np.ndarray:
    """Sizes (n) of the first swings of the link, up to the first whose duration is not that of the free link.

    A hub that sticks makes the half period longer.
    """
    known = np.isfinite(recording[channel])
    time, values = recording.time[known], recording[channel][known]
    period = sample_period(time)
    half = 0.5 / frequency / period
    # The release excites higher modes too.
    smooth = sosfiltfilt(_low_pass(frequency, period), values)
    tops = np.sort(
        np.r_[
            find_peaks(smooth, distance=_MIN_SPACING * half)[0],
            find_peaks(-smooth, distance=_MIN_SPACING * half)[0],
        ]
    )
    swings = np.abs(np.diff(smooth[tops]))
    invalid = (np.abs(np.diff(tops) / half - 1) > _MAX_DURATION_ERROR) | (swings < _MIN_SWING * noise)
    return swings[: int(np.argmax(invalid)) if invalid.any() else len(swings)]


def _low_pass(frequency: float, period: float) -> np.ndarray:
    """Second-order sections of the low-pass for swings at a free frequency [Hz]."""
    return butter(3, min(_BAND * frequency, 0.45 / period), fs=1 / period, output="sos")


def _swing_covariance(count: int, period: float, frequency: float, noise: float) -> np.ndarray:
    """Covariance (count x count) of swings by the sensor's white noise after the low-pass.

    Successive swings share an extreme: its error enters both with the same sign.
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


def _equivalent_damping(swings: np.ndarray, scatter: np.ndarray | None = None) -> Estimate:
    """Equivalent damping ratio of swings (n) by their logarithmic decrement; `scatter` is their covariance (n x n).

    A swing is half a period: ln(a_k/a_k+1) = pi zeta/sqrt(1 - zeta^2). Friction makes ln(a_k) nonlinear in k, in the
    measured and in the simulated decay alike.
    """
    x = _centred_indices(len(swings))
    slope = float(x @ np.log(swings) / (x @ x))
    weights = x / swings / (x @ x)
    error = 0.0 if scatter is None else math.sqrt(float(weights @ scatter @ weights))
    return Estimate(-slope / math.pi, error / math.pi)


def _centred_indices(count: int) -> np.ndarray:
    """Indices of swings (count) about the middle one."""
    return np.arange(count) - (count - 1) / 2


def _simulate_release(
    model: Model, prepared: Prepared, start: Start, level: float, deflection: float
) -> Recording:
    """Simulates the release from a deflection [m] with a Coulomb level [N m]."""
    tried = model.replace(declared=model.declared.replace("tried", coulomb_friction=level))
    recording = prepared.recording.replace(initial_tip_deflection=deflection)
    return simulate(tried, recording, sensor_corrected_start(tried, prepared, start))


def _invert_map(levels: np.ndarray, damping: np.ndarray, measured: Estimate) -> Estimate | None:
    """The level at which the map equals the measured ratio, with its error by the slope there; None without one."""
    rising = np.diff(damping) > 0
    crossing = (damping[:-1] <= measured.value) & (measured.value < damping[1:])
    if not rising.all() or not crossing.any():
        return None
    k = int(np.argmax(crossing))
    slope = (damping[k + 1] - damping[k]) / (levels[k + 1] - levels[k])
    level = levels[k] + (measured.value - damping[k]) / slope
    return Estimate(float(level), float(measured.standard_error / slope))
