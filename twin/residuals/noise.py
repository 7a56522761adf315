"""Noise of the residuals of a recording whose measured hub angle drives the modelled link.

Noise of the hub angle excites the modelled link at its own frequencies, and it rings on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.fft import rfftfreq
from scipy.ndimage import binary_dilation, uniform_filter1d

from twin.recording import Recording
from twin.residuals import resample, ringing
from twin.residuals.cache import Cache
from twin.residuals.filters import BAND, GRID, STRIDE, low_pass_gain, low_passed, smooth_spline
from twin.residuals.hub_balance import delivered_torque
from twin.residuals.prepared import Prepared
from twin.residuals.residual import continuous_residual, scaled
from twin.residuals.ringing import Ringing, RingingMode
from twin.residuals.view import SETTLING, NoiseModel, Signals, filtered, move_link, padded_length
from twin.rigs.model import Model
from twin.rigs.simulate import sensor_readings

_DRAWS = 4  # realisations of the noise that are simulated


def sensor_noise(prepared: Prepared, by_hub: dict[str, float]) -> dict[str, float]:
    """Channel other than the hub angle -> standard deviation of its low-passed noise.

    Args:
      prepared: the recording.
      by_hub: channel -> standard deviation of its simulated value by noise of the hub angle, added in quadrature.
    """
    share = np.sqrt(2 * BAND * prepared.recording.period)
    noise = {c: prepared.noise[c] * min(1.0, share) for c in prepared.channels if c != "hub_angle"}
    return {name: float(np.hypot(value, by_hub.get(name, 0.0))) for name, value in noise.items()}


def propagated_noise(
    signals: Signals, prepared: Prepared, model: Model
) -> tuple[dict[str, float], np.ndarray]:
    """Noise of the residuals by a simulation with additional noise of the hub angle.

    Returns:
      Channel -> standard deviation, as `sensor_noise`; and a realisation of the noise of the required torque on the
      hub (m) [N m], not finite if the simulated link diverges.
    """
    plain, torque = move_link(signals, prepared, model, prepared.start)
    noisy = _with_hub_noise(signals, prepared, np.random.default_rng(0), np.ones(len(signals.time)))
    moved, torque_moved = move_link(noisy, prepared, model, prepared.start)
    blank = Recording(
        "",
        signals.time,
        {c: np.zeros(len(signals.time)) for c in signals.measured if c != "motor_torque"},
    )
    a, b = sensor_readings(model, blank, plain), sensor_readings(model, blank, moved)
    with np.errstate(invalid="ignore"):  # a simulation that diverges
        by_hub = {c: float(np.std(low_passed(a[c] - b[c], GRID))) for c in blank.measured()}
        return sensor_noise(prepared, by_hub), low_passed(torque_moved - torque, GRID)


def noise_scale(
    signals: Signals, noise: NoiseModel, prepared: Prepared, model: Model
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Local size of the noise, by simulations with realisations of the noise of a moving hub.

    The noise model treats the response to that noise as stationary. A link that bends far responds several times as
    strongly, at other frequencies than those at which it rings. A hub that rests makes no noise, but the link that it
    moved before still oscillates.

    Returns:
      Residual -> size of the noise at its rows (r) relative to that of quiet stretches; and standard deviation of the
      link's torque on the hub (m) [N m].
    """
    moving, torque_variance = signals.direction != 0, np.zeros(len(signals.time))
    if not moving.any():
        return {}, torque_variance
    generator = np.random.default_rng(1)
    plain, torque = _simulated(signals, noise, prepared, model)
    squares = {name: np.zeros(len(moving[::STRIDE])) for name in noise.ringing}
    for _ in range(_DRAWS):
        drawn = _with_hub_noise(signals, prepared, generator, moving)
        noisy, noisy_torque = _simulated(drawn, noise, prepared, model)
        squares = {name: s + (noisy[name] - plain[name]) ** 2 / _DRAWS for name, s in squares.items()}
        torque_variance += (noisy_torque - torque) ** 2 / _DRAWS
    known = {**signals.known, "hub_torque": signals.sliding}
    scales = {name: _local_scale(s, known[name][::STRIDE], moving[::STRIDE]) for name, s in squares.items()}
    return scales, np.sqrt(torque_variance)


def _simulated(
    signals: Signals, noise: NoiseModel, prepared: Prepared, model: Model
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Residuals of channels and hub torque in multiples of the noise (r), and the required torque (m) [N m]."""
    motion, required = move_link(signals, prepared, model, prepared.start)
    delivered = delivered_torque(signals, prepared, model)
    raw = continuous_residual(signals, prepared, model, motion, required, delivered)
    return scaled(raw, noise, model), required


def _with_hub_noise(
    signals: Signals, prepared: Prepared, generator: np.random.Generator, share: np.ndarray
) -> Signals:
    """The signals with additional noise of the hub angle, multiplied by a share (m)."""
    period, start = prepared.recording.period, signals.time[0]
    at = start + period * np.arange(round((signals.time[-1] - start) / period) + 1)
    readings = generator.normal(0, prepared.noise["hub_angle"], len(at))
    drawn = low_passed(resample.spline(at, readings, period)(signals.time), GRID, signals.band) * share
    spline = smooth_spline(signals.time, drawn)
    return replace(
        signals,
        motions=Cache(1),
        reading=signals.reading + drawn,
        rate=signals.rate + spline(signals.time, 1),
        acceleration=signals.acceleration + spline(signals.time, 2),
    )


def _local_scale(squares: np.ndarray, known: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """Local size of a noise of unit size in quiet stretches (r).

    Args:
      squares: of the part of the noise that varies (r).
      known: whether there is a residual (r).
      moving: whether the hub moves (r).
    """
    size = 2 * int(SETTLING / (STRIDE * GRID)) + 1
    share = uniform_filter1d(known.astype(float), size, mode="constant")
    local = uniform_filter1d(squares * known, size, mode="constant") / np.maximum(share, 1 / size)
    usual = float(np.median(local[known & moving])) if (known & moving).any() else 0.0
    return np.sqrt(1 + np.maximum(local - usual, 0.0))


def torque_noise(signals: Signals, modes: Sequence[RingingMode], torque: np.ndarray) -> float:
    """Standard deviation of the noise of the torque on the hub without the ringing of some modes [N m].

    Args:
      signals: the recording.
      modes: that ring.
      torque: realisation of the noise (m) [N m].
    """
    torque = torque[::STRIDE]
    rows = _torque_rows(signals, modes)
    rows /= np.std(torque)
    return float(np.std(_ringing_at_rows(rows, np.ones(len(torque))).whitened(torque)))


def torque_ringing(signals: Signals, modes: Sequence[RingingMode], noise: float) -> Ringing:
    """Ringing of the torque on the hub where it slides, in multiples of its other noise [N m]."""
    rows = _torque_rows(signals, modes)
    rows /= noise
    return _ringing_at_rows(rows, signals.sliding[::STRIDE])


def _torque_rows(signals: Signals, modes: Sequence[RingingMode]) -> np.ndarray:
    """Ringing of the torque at the rows of its residual (k x r) [N m]."""
    time = signals.time[::STRIDE]
    rows, first = np.empty((2 * sum(len(mode.begin) for mode in modes), len(time))), 0
    for mode in modes:
        count = len(mode.begin)
        for k in range(count):  # one at a time: of all, a long recording has no memory for a temporary array
            rows[[first + k, first + count + k]] = mode.pull * mode.coordinate(time, slice(k, k + 1)).T
        first += 2 * count
    return rows


def link_ringing(
    signals: Signals, whitening: dict[str, np.ndarray], model: Model, modes: Sequence[RingingMode]
) -> dict[str, Ringing]:
    """Channel -> ringing of its residual behind its whitening filter, and any course in and behind a gap of the hub."""
    hats = _unseen(signals.settled).T
    count = len(hats) + 2 * sum(len(mode.begin) for mode in modes)
    rows = {channel: np.empty((count, len(signals.time[::STRIDE]))) for channel in whitening}
    for channel, gain in whitening.items():
        rows[channel][: len(hats)] = _rows(hats * np.std(signals.measured[channel]), gain)
    first = len(hats)
    for mode in modes:
        readings = {channel: model.link_rows[channel] @ mode.shape[1:] for channel in whitening}
        for k in range(len(mode.begin)):  # one at a time stands at every instant of the grid
            coordinate = mode.coordinate(signals.time, slice(k, k + 1)).T
            for channel, gain in whitening.items():
                rows[channel][first : first + 2] = _rows(readings[channel] * coordinate, gain)
            first += 2
    # A channel's rows go as soon as its directions are there: in long recordings they take more memory than all else.
    return {
        channel: _ringing_at_rows(rows.pop(channel), signals.known[channel][::STRIDE])
        for channel in whitening
    }


def _rows(values: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Signals (k x m) behind a filter, at the rows of a residual (k x r)."""
    return filtered(values, gain)[:, ::STRIDE]


def _ringing_at_rows(rows: np.ndarray, known: np.ndarray) -> Ringing:
    """`ringing.from_columns` of ringing at the rows of a residual (k x r), each of which stands for `STRIDE` instants.

    Noise within the band has ten times the variance of an instant in one direction: so ringing counts ten times more
    than the noise alone warrants. At the frequencies of the link the model itself is off, too: with the weight of the
    noise, a function of the strain became significant in a campaign of another engine that lacks nothing.

    Args:
      rows: the ringing, scaled in place.
      known: whether there is a residual (r).
    """
    rows *= np.sqrt(STRIDE) * known
    return ringing.from_columns(rows.T)


def _unseen(known: np.ndarray) -> np.ndarray:
    """Hat functions (m x k) where a channel is unknown and what the low-pass reaches beside it: any course there."""
    half = round(1 / (2 * BAND * GRID))  # width of a hat to either side, in instants
    reach = binary_dilation(~known, iterations=2 * half)
    centres = np.arange(0, len(known), half)
    centres = centres[binary_dilation(reach, iterations=half - 1)[centres]]
    return np.maximum(1 - np.abs(np.arange(len(known))[:, None] - centres) / half, 0.0)


def whitening_filters(signals: Signals, prepared: Prepared, model: Model) -> dict[str, np.ndarray]:
    """Channel -> gain over frequency that makes the noise of its residual white with unit variance behind the filter.

    The channels are those of `Model.link_rows`. The noise is that of the sensor and the response of the link's clamped
    modes to noise of the hub angle. The gain is at the frequencies of the residual with its padding, see
    `view.filtered`.
    """
    count = len(signals.time)
    f = rfftfreq(padded_length(count), GRID)
    period = prepared.recording.period
    hub = 2 * prepared.noise["hub_angle"] ** 2 * period * low_pass_gain(f, GRID, signals.band) ** 2
    wide = float(np.trapezoid(low_pass_gain(f, GRID) ** 2, f))
    omega = 2 * np.pi * f
    frequencies, shapes = model.chain.modes("clamped")
    # Modes that ring for longer are treated by `Ringing`: a filter as sharp would ring as long itself.
    ratios = np.maximum(model.chain.damping_ratios("clamped"), 1 / (ringing.MIN_DECAY_TIME * frequencies))
    participations = model.chain.mass_matrix()[0, 1:] @ shapes[1:]
    gains = {}
    for channel, row in model.link_rows.items():
        if channel not in signals.measured:
            continue
        response = sum(
            reading * omega**2 / (w**2 - omega**2 + 2j * z * w * omega)
            for reading, w, z in zip(row @ shapes[1:] * participations, frequencies, ratios, strict=True)
        )
        own = 2 * prepared.noise[channel] ** 2 * period
        gains[channel] = 1 / np.sqrt((own + np.abs(response) ** 2 * hub) * wide)
    return gains
