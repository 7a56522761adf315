"""Makes the view of a recording: resampled and filtered signals, sliding of the hub, and the noise of the residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import binary_dilation

from twin.campaigns.rests import HubMotion
from twin.mechanics.planar import STUCK
from twin.recording import ON_LINK, Recording
from twin.residuals import backlash, creep, resample, ringing
from twin.residuals.filters import BAND, GRID, MOTION_BANDS, REACH, low_passed, smooth_spline
from twin.residuals.hub_balance import usable_break_aways
from twin.residuals.noise import (
    link_ringing,
    noise_scale,
    propagated_noise,
    sensor_noise,
    torque_noise,
    torque_ringing,
    whitening_filters,
)
from twin.residuals.prepared import Prepared
from twin.residuals.significance import CERTAIN, SIGNIFICANT
from twin.residuals.view import SETTLING, NoiseModel, Signals, View, before_end, move_link
from twin.rigs.model import Model

_MAX_NOISE = 0.5
"""Noise of the acceleration, relative to strong accelerations, up to which a band is not too wide."""


def make_view(prepared: Prepared, model: Model, bands: Sequence[float] = MOTION_BANDS) -> View:
    """The view of a recording, its noise propagated through a model.

    Args:
      prepared: the recording.
      model: its link, driven by the measured hub.
      bands: cut-offs to choose from for the motion of the hub, as `filters.MOTION_BANDS` [Hz].
    """
    if prepared.hub is None:
        return _view(_clamped_signals(prepared), NoiseModel(noise=sensor_noise(prepared, {})))
    signals = hub_signals(prepared, prepared.hub, model, bands)
    whitening = whitening_filters(signals, prepared, model)
    noise, torque = propagated_noise(signals, prepared, model)
    if not np.isfinite(torque).all():
        return _diverged_view(signals, NoiseModel(noise=noise, whitening=whitening))
    slow, _ = _noise_limits(prepared, signals.band)
    undetermined = backlash.undetermined(signals, prepared, model, float(np.std(torque)), slow)
    signals = replace(signals, sliding=signals.sliding & ~undetermined)
    density = prepared.noise["hub_angle"] ** 2 * prepared.recording.period
    usual = float(np.std(signals.acceleration))
    gaps = resample.gaps_of(prepared.recording, "hub_angle")
    unknown = [(begin, usual * (end - begin)) for begin, end in gaps]
    modes_of = partial(
        ringing.ringing_modes, model, signals.time, signals.direction != 0, density, BAND, unknown
    )
    lightly_damped = modes_of(decay_time=ringing.MIN_DECAY_TIME)
    # Modes that ring for less count twice, in the noise besides: away from them the model's own error is as large.
    noise["hub_torque"] = torque_noise(signals, lightly_damped, torque)
    rings = {
        "hub_torque": torque_ringing(signals, modes_of(), noise["hub_torque"]),
        **link_ringing(signals, whitening, model, lightly_damped),
    }
    stationary = NoiseModel(noise=noise, whitening=whitening, ringing=rings)
    scale, link_torque_noise = noise_scale(signals, stationary, prepared, model)
    motion, _ = move_link(signals, prepared, model, prepared.start)
    departures = creep.slow_onsets(prepared, model, motion)
    _, departing = creep.departure_residual(signals.time, prepared, model, motion, departures)
    return _view(
        signals,
        replace(stationary, noise_scale=scale),
        departures=departures,
        departing=departing,
        link_torque_noise=link_torque_noise,
    )


def _view(signals: Signals, noise: NoiseModel, **more) -> View:
    return View(**vars(signals), **vars(noise), **more)


def _diverged_view(signals: Signals, noise: NoiseModel) -> View:
    """The view of a recording under whose motion the modelled link diverges: infinite noise, nothing is compared."""
    count = len(signals.time)
    return _view(
        signals,
        replace(noise, noise=dict.fromkeys((*noise.noise, "hub_torque"), np.inf)),
        departing=np.zeros(count, dtype=bool),
        link_torque_noise=np.zeros(count),
    )


def _grid_of(recording: Recording) -> np.ndarray:
    """Instants of the uniform grid of a recording (m) [s]."""
    count = max(2, int(np.floor(recording.duration / GRID)) + 1)
    return recording.time[0] + GRID * np.arange(count)


def _resampled(
    prepared: Prepared, time: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, np.ndarray]]:
    """`Signals.measured`, `known` and `with_gaps` of all channels but the hub angle."""
    measured, known, with_gaps = {}, {}, {}
    for channel in prepared.channels:
        if channel != "hub_angle":
            values, known[channel] = resample.resample_channel(prepared.recording, channel, time)
            measured[channel] = low_passed(values, GRID)
            if channel != "motor_torque" and not known[channel].all():
                with_gaps[channel] = values
    return measured, known, with_gaps


def _clamped_signals(prepared: Prepared) -> Signals:
    """The signals of a recording whose hub is clamped; of a free hub without readings nothing is known."""
    time = _grid_of(prepared.recording)
    measured, known, with_gaps = _resampled(prepared, time)
    if not prepared.recording.clamped:
        known = {channel: np.zeros(len(time), dtype=bool) for channel in known}
    still = np.zeros(len(time))
    # Gravity bends the link according to the angle at which the hub is held.
    held = np.full(len(time), prepared.start.hub_angle)
    return Signals(time, held, still, still, still, still > 0, measured, known, (), with_gaps=with_gaps)


def hub_signals(
    prepared: Prepared, hub: HubMotion, model: Model, bands: Sequence[float] = MOTION_BANDS
) -> Signals:
    """The signals of a recording with a free hub.

    Args:
      prepared: the recording.
      hub: its rests and motion.
      model: for the drive, and for the friction that may hold the hub.
      bands: cut-offs to choose from for the motion of the hub [Hz].
    """
    recording, time = prepared.recording, _grid_of(prepared.recording)
    measured, known, with_gaps = _resampled(prepared, time)
    raw, read = resample.resample_hub_angle(model, with_rests_held(recording, hub), time)
    stuck = np.interp(time, recording.time, (hub.observed == STUCK).astype(float)) > 0.5
    settled = _settled(recording, time)
    unknown, usable = stuck | ~read, before_end(time, REACH) & settled
    wide = motion_bands(recording, prepared.noise["hub_angle"], time, bands)
    motion = _most_certain_motion(prepared, model, raw, unknown, usable, wide)
    # Modelled strains follow a motion that has passed this filter, so measured ones pass it too.
    measured |= {c: low_passed(v, GRID, motion.band) for c, v in measured.items() if c != "motor_torque"}
    known = {c: values & settled if c in ON_LINK else values for c, values in known.items()}
    ends = [(int(np.searchsorted(time, recording.time[k])), d) for k, d in hub.onsets]
    onsets = usable_break_aways(ends, stuck, model.drive(recording).at(time))
    direction = np.where(stuck, 0.0, np.sign(motion.rate))
    return Signals(
        time,
        motion.reading,
        motion.rate,
        motion.acceleration,
        direction,
        motion.sliding,
        measured,
        known,
        onsets,
        motion.band,
        with_gaps,
        settled,
    )


@dataclass(frozen=True)
class _Motion:
    """Motion of the hub behind a low-pass; m instants.

    Attributes:
      band: cut-off [Hz].
      reading, rate, acceleration: of the hub (m) [rad], [rad/s], [rad/s^2].
      sliding: whether it slides for certain (m).
    """

    band: float
    reading: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    sliding: np.ndarray

    @property
    def independent(self) -> float:
        """Independent values of the torque on a sliding hub, up to a constant factor [Hz]."""
        return float(self.sliding.mean()) * self.band


def _most_certain_motion(
    prepared: Prepared,
    model: Model,
    raw: np.ndarray,
    unknown: np.ndarray,
    usable: np.ndarray,
    bands: Sequence[float],
) -> _Motion:
    """The motion behind the low-pass that leaves the most independent values of the torque on a sliding hub.

    A wide band lets through the noise behind which a slow hub may stick, and what is near such an instant is unknown.

    Args:
      prepared: the recording.
      model: for the friction that may hold the hub.
      raw: reading of the hub (m) [rad].
      unknown: where the hub sticks or is not read (m).
      usable: where the torque on it is of use (m).
      bands: to choose from, the widest first [Hz].
    """
    best, grid = None, GRID * np.arange(len(raw))
    for band in bands:
        if best is not None and best.independent >= band:
            break  # though it slides at every instant
        reading = low_passed(raw, GRID, band)
        spline = smooth_spline(grid, reading)
        rate, acceleration = spline(grid, 1), spline(grid, 2)
        unclear = unknown | _may_stick(rate, acceleration, _noise_limits(prepared, band), model)
        sliding = usable & ~binary_dilation(unclear, iterations=round(REACH / GRID))
        here = _Motion(band, reading, rate, acceleration, sliding)
        if best is None or here.independent > best.independent:
            best = here
    assert best is not None
    return best


def _settled(recording: Recording, time: np.ndarray) -> np.ndarray:
    """Whether no reading of the hub is missing at instants (m) or less than `SETTLING` before.

    What the hub did in a gap is unknown, and the link rings at first as no linear response to it tells.
    """
    settled = np.ones(len(time), dtype=bool)
    for begin, end in resample.gaps_of(recording, "hub_angle"):
        settled &= (time < begin) | (time > end + SETTLING)
    return settled


def with_rests_held(recording: Recording, hub: HubMotion) -> Recording:
    """The recording with a constant hub angle in each rest, where all its changes are noise."""
    held = np.where(hub.observed == STUCK, hub.reading, recording["hub_angle"])
    return recording.replace(channels={**recording.channels, "hub_angle": held})


def motion_bands(
    recording: Recording, noise: float, time: np.ndarray, bands: Sequence[float] = MOTION_BANDS
) -> Sequence[float]:
    """The bands in which the strongest accelerations of the hub exceed their noise, else the last one [Hz].

    Of several, those that take nothing from the signals of the link, which pass the same filter besides their own.

    Args:
      recording: with a free hub.
      noise: standard deviation of the hub angle [rad].
      time: uniform grid (m) [s].
      bands: cut-offs to choose from, the widest first [Hz].
    """
    reading = low_passed(resample.resample_channel(recording, "hub_angle", time)[0], GRID, bands[-1])
    strong = np.quantile(np.abs(CubicSpline(time, reading)(time, 2)), 0.99)
    for k, band in enumerate(bands):
        if noise * derivative_noise(band, recording.period, 2) < _MAX_NOISE * strong:
            return [b for b in bands[k:] if b >= BAND] or bands[k : k + 1]
    return bands[-1:]


def derivative_noise(band: float, period: float, order: int) -> float:
    """Standard deviation of the k-th derivative of low-passed unit white noise, (2 pi f)^k sqrt(2 f dt/(2 k + 1)).

    Args:
      band: cut-off f [Hz].
      period: sample period dt [s].
      order: k.
    """
    return (2 * np.pi * band) ** order * float(np.sqrt(2 * band * period / (2 * order + 1)))


def _noise_limits(prepared: Prepared, band: float) -> tuple[float, float]:
    """Rate [rad/s] and acceleration [rad/s^2] of the hub below which they may be noise."""
    noise, period = prepared.noise["hub_angle"], prepared.recording.period
    slow = SIGNIFICANT * noise * derivative_noise(band, period, 1)
    return slow, CERTAIN * noise * derivative_noise(band, period, 2)


def _may_stick(
    rate: np.ndarray, acceleration: np.ndarray, noise_limits: tuple[float, float], model: Model
) -> np.ndarray:
    """Whether the hub may have stuck for a moment, at reversals and in slow stretches (m).

    A hub that sticks has neither rate nor acceleration, but the filter hides a short stick between the motions before
    and behind it. There was none where the acceleration exceeds its noise and what static friction, with a margin, can
    decelerate.

    Args:
      rate: of the hub (m) [rad/s].
      acceleration: of the hub (m) [rad/s^2].
      noise_limits: rate and acceleration that may be noise.
      model: its static friction and inertia.
    """
    slow, weak = noise_limits
    holdable = backlash.STATIC_MARGIN * model.declared["static_friction"] / model.chain.free_hub_inertia()
    return (np.abs(rate) < slow) & (np.abs(acceleration) < max(weak, holdable))
