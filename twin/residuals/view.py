"""One recording on a uniform grid, low-passed, with the noise of its residuals; the link driven by the measured hub.

The measured hub angle drives the modelled link: its strains then do not depend on friction, and the torque on the hub
that the motion requires is known at every instant.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.fft import irfft, prev_fast_len, rfft
from scipy.interpolate import CubicSpline

from twin.mechanics import planar
from twin.mechanics.state import Motion, Start
from twin.residuals import creep
from twin.residuals.cache import Cache, LinkMotion
from twin.residuals.filters import GRID, MOTION_BANDS, SPLINE_DEGREE, smooth_spline
from twin.residuals.prepared import Prepared
from twin.residuals.ringing import Ringing
from twin.rigs.model import Model
from twin.rigs.simulate import initial_state

PADDING = int(3.0 / GRID)
"""Samples by which a residual is continued before it is whitened: 3 s; behind it a few less, see `padded_length`."""
SETTLING = 0.5
"""Span after which an unknown state no longer matters [s]: of the link at the start of a moving rig or behind a gap, of
a motor in its play. Not compared until then."""


@dataclass(frozen=True)
class Signals:
    """One recording on a uniform grid, low-passed; m instants.

    Attributes:
      time: [s] (m).
      reading, rate, acceleration: of the hub's reading [rad], [rad/s], [rad/s^2] (m); constant where it is clamped.
      direction: sign of the hub's motion, 0 where it rests or that is unclear (m).
      sliding: whether the hub slides for certain throughout the reach of the filter (m).
      measured: channel other than the hub angle -> readings (m).
      known: channel -> whether its readings are there (m).
      onsets: index and direction of break-aways under a slowly growing torque.
      band: cut-off of the low-pass on the motion of the hub [Hz].
      with_gaps: strain with missing readings -> readings before the filter, gaps interpolated (m).
      settled: whether no reading of the hub is missing there or less than `SETTLING` before (m); empty where it is
        clamped.
      motions: simulated motions of the link.
      torques: torques of the drive, see `hub_balance.delivered_torque`.
      residuals: of channels by their simulated readings, see `residual.channel_residual`.
    """

    time: np.ndarray
    reading: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    direction: np.ndarray
    sliding: np.ndarray
    measured: dict[str, np.ndarray]
    known: dict[str, np.ndarray]
    onsets: tuple[tuple[int, int], ...]
    band: float = MOTION_BANDS[0]
    with_gaps: dict[str, np.ndarray] = field(default_factory=dict, repr=False)
    settled: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool), repr=False)
    motions: Cache[LinkMotion] = field(default_factory=Cache, repr=False)
    torques: Cache[np.ndarray] = field(default_factory=Cache, repr=False)
    residuals: Cache[np.ndarray] = field(default_factory=Cache, repr=False)


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """Noise of the residuals of one recording on a grid; m instants. Where the hub is clamped, `noise` alone is there.

    Attributes:
      noise: channel or "hub_torque" -> standard deviation behind the filter, without ringing.
      whitening: channel -> gain over frequency of the filter that makes its residual white, see `whitened`.
      ringing: channel or "hub_torque" -> coherent oscillation by noise of the hub angle.
      noise_scale: channel or "hub_torque" -> noise at its rows relative to that of quiet stretches (r).
    """

    noise: dict[str, float]
    whitening: dict[str, np.ndarray] = field(default_factory=dict, repr=False)
    ringing: dict[str, Ringing] = field(default_factory=dict, repr=False)
    noise_scale: dict[str, np.ndarray] = field(default_factory=dict, repr=False)


@dataclass(frozen=True)
class View(Signals, NoiseModel):
    """One recording on a grid with the noise of its residuals; m instants.

    Attributes:
      departures: break-aways whose readings are compared: first visible sample of the recording, and direction.
      departing: whether readings at an instant are compared for one of these (m); empty where the hub is clamped.
      link_torque_noise: standard deviation of the link's torque on the hub, because noise of the hub angle excites the
        modelled link (m) [N m]; empty where the hub is clamped.
      normalised: residuals (r) of channels in multiples of the noise by those in their unit, see `residual.residual`.
    """

    departures: tuple[creep.Onset, ...] = ()
    departing: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool), repr=False)
    link_torque_noise: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False)
    normalised: Cache[np.ndarray] = field(default_factory=Cache, repr=False)


def whitened(values: np.ndarray, model: NoiseModel, channel: str) -> np.ndarray:
    """A residual (..., m) in multiples of the noise; strain and tip deflection with white noise up to `filters.BAND`.

    Noise of the hub angle excites the modelled link at its clamped modes for seconds. Near their frequencies, a
    residual of these has little weight.
    """
    gain = model.whitening.get(channel)
    return values / model.noise[channel] if gain is None else filtered(values, gain)


def filtered(values: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """A signal (..., m) behind a zero-phase filter with a gain over frequency; continued by its odd extension."""
    count = values.shape[-1]
    length, pad = padded_length(count), min(count - 1, PADDING)
    before = 2 * values[..., :1] - values[..., pad:0:-1]
    behind = 2 * values[..., -1:] - values[..., -2 : count + pad - length - 2 : -1]
    extended = np.concatenate([before, values, behind], axis=-1)
    white = irfft(rfft(extended) * gain, length)
    return white[..., pad : pad + count]


def padded_length(count: int) -> int:
    """Length of a signal of `count` samples with its continuation: one whose Fourier transform is fast."""
    return prev_fast_len(count + 2 * min(count - 1, PADDING), real=True)


def move_link(signals: Signals, prepared: Prepared, model: Model, start: Start) -> tuple[Motion, np.ndarray]:
    """Motion of the link under the measured hub, and the torque on the hub that it requires (m) [N m].

    Models that differ in drive and hub alone share their motions, see `cache`.
    """
    hub = hub_trajectory(signals, model)
    phi, omega = initial_state(model, prepared.recording, start)
    # A motor with backlash is part of the delivered torque, see `hub_balance.delivered_torque`.
    plant = model.plant_of(prepared.recording).without_motor()

    def simulated() -> LinkMotion:
        first = plant.extend_state(phi), plant.extend_state(omega)
        if prepared.recording.start == "unknown":
            first = first[0], first[1] - omega[0] + hub.rate[0]
        motion = hub.angle, hub.rate, hub.acceleration, _halfway(hub.acceleration)
        return planar.simulate_prescribed_hub(plant, signals.time, *motion, *first, model.stable_step)

    inputs = (*plant.link, model.step, hub.angle, phi, omega)
    angles, rates, required = signals.motions.get(inputs, simulated)
    return Motion.from_coordinates(signals.time, angles, rates, hub.direction, len(phi)), required


@dataclass(frozen=True)
class HubTrajectory:
    """Motion of the hub itself, not its reading (m): angle [rad], rate [rad/s], acceleration [rad/s^2], direction."""

    angle: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    direction: np.ndarray


def _halfway(values: np.ndarray) -> np.ndarray:
    """Values (m - 1) halfway between those on a uniform grid (m), by the polynomials through six of them.

    The error of an oscillation is 0.005 (omega h)^6: at 25 Hz and h = 2 ms 5e-6.
    """
    padded = np.pad(values, 2, mode="reflect", reflect_type="odd")
    return np.convolve(padded, np.array([3, -25, 150, 150, -25, 3]) / 256, mode="valid")


def hub_trajectory(signals: Signals, model: Model) -> HubTrajectory:
    """The motion of the hub that the model's sensor reports as the reading.

    At the end of the recording, what a late sensor has not yet reported is extrapolated at constant acceleration.
    """
    angle = model.hub_angle_of(signals.reading, signals.time)
    if np.array_equal(angle, signals.reading):
        return HubTrajectory(angle, signals.rate, signals.acceleration, signals.direction)
    read = before_end(signals.time, model.hub_late)
    read[: SPLINE_DEGREE + 1] = True
    spline = smooth_spline(signals.time[read], angle[read])
    last = signals.time[read][-1]
    at, beyond = np.minimum(signals.time, last), np.maximum(signals.time - last, 0.0)
    acceleration = spline(at, 2)
    rate = spline(at, 1) + acceleration * beyond
    angle = np.where(read, angle, spline(at) + (rate - acceleration * beyond / 2) * beyond)
    seen = np.minimum(np.searchsorted(signals.time, signals.time + model.hub_late), len(rate) - 1)
    return HubTrajectory(
        angle, rate, acceleration, np.where(signals.direction[seen] == 0, 0.0, np.sign(rate))
    )


def as_read(time: np.ndarray, late: float, values: np.ndarray) -> np.ndarray:
    """Values (..., m) of a motion, smooth, at the instants (m) at which a late sensor shows it [s].

    What is known of a recording, as where its hub slides, is known on the clock of its readings.
    """
    if late == 0 or not np.isfinite(values).all():
        return values
    return CubicSpline(time, values, axis=-1)(np.clip(time - late, time[0], time[-1]))


def before_end(time: np.ndarray, span: float) -> np.ndarray:
    """Whether instants (m) lie at least a span before the last one [s]."""
    return time <= time[-1] - span
