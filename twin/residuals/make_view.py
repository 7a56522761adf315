"""How a recording is looked at: its grid, its filters, where its hub surely slides, and the noise of all that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import binary_dilation

from twin.campaigns.rests import HubMotion
from twin.mechanics.planar import STUCK
from twin.recording import Recording
from twin.residuals import backlash, creep, resample, ringing
from twin.residuals.filters import BAND, GRID, MOTION_BANDS, REACH, low_passed, smooth
from twin.residuals.hub_balance import well_defined
from twin.residuals.noise import evened, propagated, sensor_noise, swell, swinging_strains, whitening
from twin.residuals.prepared import Prepared
from twin.residuals.view import LEFT_OUT, View, before_end, move
from twin.rigs.model import Model

_CLEAR = 0.5  # error of the acceleration, in parts of strong ones, up to which a band is not too wide
_SURE = 5.0  # standard errors of the acceleration at a reversal beyond which the hub cannot have stuck


def look(prepared: Prepared, model: Model, bands: Sequence[float] = MOTION_BANDS) -> View:
    """Filters a recording and propagates its noise through the model; `bands`: as `MOTION_BANDS`."""
    recording = prepared.recording
    count = max(2, int(np.floor(recording.duration / GRID)) + 1)
    time = recording.time[0] + GRID * np.arange(count)
    measured, known, holes = {}, {}, {}
    for channel in prepared.channels:
        if channel != "hub_angle":
            values, known[channel] = resample.resampled(recording, channel, time)
            measured[channel] = low_passed(values, GRID)
            if channel != "motor_torque" and not known[channel].all():
                holes[channel] = values
    still = np.zeros(count)
    if prepared.hub is None:
        rest = still, still, still, still, still > 0
        return View(time, *rest, measured, known, sensor_noise(prepared, {}), (), holes=holes)
    band = motion_band(recording, prepared.noise["hub_angle"], time, bands)
    reading, read = resample.hub_resampled(model, at_rest(recording, prepared.hub), time)
    reading = low_passed(reading, GRID, band)
    # Modelled strains follow a motion that has passed this filter too.
    measured |= {c: low_passed(v, GRID, band) for c, v in measured.items() if c != "motor_torque"}
    spline = smooth(time, reading)
    rate, acceleration = spline(time, 1), spline(time, 2)
    stuck = np.interp(time, recording.time, (prepared.hub.observed == STUCK).astype(float)) > 0.5
    direction = np.where(stuck, 0.0, np.sign(rate))
    doubtful = stuck | ~read | _may_stick(rate, acceleration, _unsure(prepared, band), _grip(model))
    sliding = before_end(time, LEFT_OUT) & ~binary_dilation(doubtful, iterations=round(REACH / GRID))
    ends = [(int(np.searchsorted(time, recording.time[k])), d) for k, d in prepared.hub.onsets]
    onsets = well_defined(ends, stuck, model.drive(recording).at(time))
    motion = reading, rate, acceleration, direction, sliding
    view = View(time, *motion, measured, known, {}, onsets, band, holes=holes)
    view = replace(view, whitening=whitening(prepared, view, model))
    noise, torque = propagated(prepared, view, model)
    if not np.isfinite(torque).all():
        # The modelled link runs away under this motion: nothing of the recording can be compared with it.
        return replace(
            view,
            noise=dict.fromkeys((*noise, "hub_torque"), np.inf),
            departing=np.zeros(count, dtype=bool),
            pull=np.zeros(count),
        )
    density = prepared.noise["hub_angle"] ** 2 * recording.period
    swings = ringing.swings(model, time, direction != 0, density, BAND)
    told = ~backlash.doubtful(view, prepared, model, float(np.std(torque)), _unsure(prepared, band)[0])
    view = replace(view, sliding=view.sliding & told)
    even, swing = evened(view, swings, torque)
    ringing_of = {"hub_torque": swing, **swinging_strains(view, model, swings)}
    view = replace(view, noise={**noise, "hub_torque": even}, ringing=ringing_of)
    louder, pull = swell(view, prepared, model)
    view = replace(view, swell=louder, pull=pull)
    moved, _ = move(view, prepared, model, prepared.start)
    leaving = creep.events(prepared, model, moved)
    _, departing = creep.residual(view.time, prepared, model, moved, leaving)
    return replace(view, departures=leaving, departing=departing)


def at_rest(recording: Recording, hub: HubMotion) -> Recording:
    """The recording with its hub angle held where it surely rests: there all its changes are noise."""
    held = np.where(hub.observed == STUCK, hub.reading, recording["hub_angle"])
    return recording.replace(channels={**recording.channels, "hub_angle": held})


def motion_band(
    recording: Recording, noise: float, time: np.ndarray, bands: Sequence[float] = MOTION_BANDS
) -> float:
    """The widest of the bands in which the strongest accelerations stand out of their noise [Hz]."""
    reading = low_passed(resample.resampled(recording, "hub_angle", time)[0], GRID, bands[-1])
    strong = np.quantile(np.abs(CubicSpline(time, reading)(time, 2)), 0.99)
    for band in bands:
        if noise * _gain(band, recording.period, 2) < _CLEAR * strong:
            return band
    return bands[-1]


def _gain(band: float, period: float, order: int) -> float:
    """Standard deviation of a derivative of unit white noise behind a low-pass: (2 pi f)^k sqrt(2 f dt/(2 k + 1))."""
    return (2 * np.pi * band) ** order * float(np.sqrt(2 * band * period / (2 * order + 1)))


def _grip(model: Model) -> float:
    """Acceleration at a reversal up to which friction can hold the hub [rad/s^2], with a margin."""
    return backlash.FIRMER * model.declared["static_friction"] / model.chain.free_hub_inertia()


def _unsure(prepared: Prepared, band: float) -> tuple[float, float]:
    """Rate [rad/s] and acceleration [rad/s^2] that the noise of a hub may seem to be."""
    noise, period = prepared.noise["hub_angle"], prepared.recording.period
    return 3 * noise * _gain(band, period, 1), _SURE * noise * _gain(band, period, 2)


def _may_stick(
    rate: np.ndarray, acceleration: np.ndarray, unsure: tuple[float, float], grip: float
) -> np.ndarray:
    """Samples (m) about reversals and slow stretches at which the hub may have stuck for a moment.

    A stick has neither rate nor acceleration, but a short one is lost between the motion before it and behind it: there
    was none where the acceleration stands out of its noise and is more than friction can hold.
    """
    slow, weak = unsure
    return (np.abs(rate) < slow) & (np.abs(acceleration) < max(weak, grip))
