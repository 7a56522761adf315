"""The recordings seen locally in time: the link driven by the measured hub, and the balance of the hub.

A free-running simulation is decided by every stick and slip. Here the measured hub angle moves the link instead:
its strains follow without friction, and the torque that the motion takes is known at every instant. What the
strains leave is missing in the link or a sensor; what drive, friction and that torque leave is missing at the hub.

All signals pass the same zero-phase low-pass, so that measured and simulated ones stay comparable.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.fft import irfft, rfft, rfftfreq
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline
from scipy.ndimage import binary_dilation, uniform_filter1d
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfreqz

from twin import departures, evidence, on_grid, planar, ringing
from twin.evidence import Group
from twin.fit import Prepared
from twin.grid_means import mean_torque, twice_averaged
from twin.model import Model, Motion, Start, initial_state, reported
from twin.observe import HubMotion
from twin.planar import STUCK
from twin.recording import Recording
from twin.ringing import Ringing, Swing

BAND = 25.0
"""Corner of the low-pass [Hz]: above the second free mode of a rig like this, below the noise of its rates."""
GRID = 0.002  # s, uniform grid on which the signals are filtered
BLOCK = 1.5
"""Length of the stretches over each of which the size of the misfit is taken as one [s]."""
MOTION_BANDS = (70.0, 45.0, 30.0, 20.0)
"""Corners of the low-pass on the motion that drives the link [Hz]: large bends make harmonics of it, but a poor
sensor cannot tell them; the widest is taken in which strong accelerations stand out of their noise."""
_CLEAR = 0.5  # error of the acceleration, in parts of strong ones, up to which a band is not too wide
_MARGIN = 0.07  # s, reach of the filter about a stick
_ROUNDS = 4  # in which friction that falls with the speed is found along with the motion that it makes
_APPROACH, _SMEAR = 0.3, 0.06  # s before a break-away between which the torque on the resting hub is read
_TRUST = 0.05  # relative error of a break-away torque that is read this way
_BLIND = 0.004  # s from a break-away to the first visible motion
_SURE = 5.0  # standard errors of the acceleration at a reversal beyond which the hub cannot have stuck
_FIRM = 1.2  # parts of its static friction that a rig may have
_EXTENSION = 3.0  # s by which a residual is continued on either side before it is whitened
_KEPT = 12  # simulations of a recording that are remembered
SINGLE = ("break_away", "departure")
"""Channels of instants that are independent of one another; the filter makes those of the others alike."""
_LAST = 0.06  # s left out at the end: a sensor that is late says nothing of them
_DRAWS = 4  # noises that are tried on the link
_LOCAL = 0.4  # s to either side over which their effect is averaged
_SETTLING = 0.5  # s left out at the start of a rig that was already moving


@dataclass(frozen=True)
class View:
    """One recording on a uniform grid, filtered.

    Attributes:
      time: (m) [s].
      reading, rate, acceleration: (m) of the hub's reading [rad], [rad/s], [rad/s^2]; zero where clamped.
      direction: (m) of the motion of the hub, 0 where it rests or is unclear.
      sliding: (m) whether the hub surely slides, with the filter's reach.
      measured: channel -> (m) filtered readings.
      known: channel -> (m) whether the readings are there.
      holes: strain -> (m) its readings before the filter, where some are missing; there they are bridged.
      noise: name -> standard deviation of what is compared, after the filter.
      onsets: (index, direction) at which a rest of the hub ends under a slowly growing torque.
      departures: samples of the recording at which the hub is seen to leave a rest, and its direction then.
      departing: (m) whether the hub's reading about these is compared.
      band: corner of the low-pass on the motion of the hub [Hz].
      whitening: channel -> gain over frequency of `whitened`; empty where the hub is clamped.
      ringing: name -> what the noise of the hub angle does to it by way of a ringing link; empty where the hub is
        clamped.
      swell: name -> (m) size of the noise in that of the quiet stretches; empty where the hub is clamped.
      moves: what the link did in the last simulations, by what it depends on.
    """

    time: np.ndarray
    reading: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    direction: np.ndarray
    sliding: np.ndarray
    measured: dict[str, np.ndarray]
    known: dict[str, np.ndarray]
    noise: dict[str, float]
    onsets: tuple[tuple[int, int], ...]
    band: float = MOTION_BANDS[0]
    whitening: dict[str, np.ndarray] = field(default_factory=dict, repr=False)
    ringing: dict[str, Ringing] = field(default_factory=dict, repr=False)
    swell: dict[str, np.ndarray] = field(default_factory=dict, repr=False)
    holes: dict[str, np.ndarray] = field(default_factory=dict, repr=False)
    departures: tuple[departures.Event, ...] = ()
    departing: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool), repr=False)
    moves: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=dict, repr=False)


def low_passed(values: np.ndarray, period: float, band: float = BAND) -> np.ndarray:
    """Zero-phase low-pass of a signal (m), or of several (..., m), on a uniform grid.

    Forwards and backwards from an odd extension, as `scipy.signal.sosfiltfilt`, whose states at rest are kept here.
    """
    sections, resting = _sections(min(band, 0.4 / period), period)
    pad = min(values.shape[-1] - 1, int(0.3 / period))
    resting = resting.reshape(len(sections), *(1,) * (values.ndim - 1), 2)
    before = 2 * values[..., :1] - values[..., pad:0:-1]
    behind = 2 * values[..., -1:] - values[..., -2 : -pad - 2 : -1]
    signal = np.concatenate([before, values, behind], axis=-1)
    for _ in range(2):
        signal, _ = sosfilt(sections, signal, zi=resting * signal[..., :1])
        signal = signal[..., ::-1]
    return signal[..., pad : signal.shape[-1] - pad]


@functools.lru_cache
def _sections(corner: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    sections = butter(3, corner, fs=1 / period, output="sos")
    return sections, sosfilt_zi(sections)


def passed(frequency: np.ndarray, period: float, band: float = BAND) -> np.ndarray:
    """Share of a sine of this frequency [Hz] that `low_passed` leaves."""
    sections, _ = _sections(min(band, 0.4 / period), period)
    return np.abs(sosfreqz(sections, frequency, fs=1 / period)[1]) ** 2


def look(prepared: Prepared, model: Model, bands: Sequence[float] = MOTION_BANDS) -> View:
    """Filters a recording and propagates its noise through the model; `bands`: as `MOTION_BANDS`."""
    recording = prepared.recording
    count = max(2, int(np.floor(recording.duration / GRID)) + 1)
    time = recording.time[0] + GRID * np.arange(count)
    measured, known, holes = {}, {}, {}
    for channel in prepared.channels:
        if channel != "hub_angle":
            values, known[channel] = on_grid.resampled(recording, channel, time)
            measured[channel] = low_passed(values, GRID)
            if channel != "motor_torque" and not known[channel].all():
                holes[channel] = values
    still = np.zeros(count)
    if prepared.hub is None:
        rest = still, still, still, still, still > 0
        return View(time, *rest, measured, known, _sensor_noise(prepared, {}), (), holes=holes)
    band = motion_band(recording, prepared.noise["hub_angle"], time, bands)
    reading, read = on_grid.hub_resampled(model, at_rest(recording, prepared.hub), time)
    reading = low_passed(reading, GRID, band)
    # Modelled strains follow a motion that has passed this filter too.
    measured |= {c: low_passed(v, GRID, band) for c, v in measured.items() if c != "motor_torque"}
    spline = smooth(time, reading)
    rate, acceleration = spline(time, 1), spline(time, 2)
    stuck = np.interp(time, recording.time, (prepared.hub.observed == STUCK).astype(float)) > 0.5
    direction = np.where(stuck, 0.0, np.sign(rate))
    doubtful = (
        stuck
        | ~read
        | _may_stick(rate, acceleration, prepared.noise["hub_angle"], recording.period, band, _grip(model))
    )
    sliding = ~binary_dilation(doubtful, iterations=int(_MARGIN / GRID))
    ends = [(int(np.searchsorted(time, recording.time[k])), d) for k, d in prepared.hub.onsets]
    onsets = _well_defined(ends, stuck, model.drive(recording).at(time))
    motion = reading, rate, acceleration, direction, sliding
    view = View(time, *motion, measured, known, {}, onsets, band, holes=holes)
    view = replace(view, whitening=_whitening(prepared, view, model))
    noise, torque = _propagated(prepared, view, model)
    density = prepared.noise["hub_angle"] ** 2 * recording.period
    swings = ringing.swings(model, time, direction != 0, density, BAND)
    even, swing = _evened(view, swings, torque)
    ringing_of = {"hub_torque": swing, **_swinging_strains(view, model, swings)}
    view = replace(view, noise={**noise, "hub_torque": even}, ringing=ringing_of)
    view = replace(view, swell=_swell(view, prepared, model))
    moved, _ = move(view, prepared, model, prepared.start)
    leaving = departures.events(prepared, model, moved)
    _, departing = departures.residual(view.time, prepared, model, moved, leaving)
    return replace(view, departures=leaving, departing=departing)


def smooth(time: np.ndarray, values: np.ndarray) -> BSpline:
    """A spline through samples (m) of a band-limited signal whose second derivative can be relied on.

    That of a cubic one is too large by (omega h)^2/12, at 18 Hz and h = 2 ms by 0.4 %.
    """
    return make_interp_spline(time, values, k=min(7, len(time) - 1 - len(time) % 2))


def at_rest(recording: Recording, hub: HubMotion) -> Recording:
    """The recording with its hub angle held where it surely rests: there all its changes are noise."""
    held = np.where(hub.observed == STUCK, hub.reading, recording["hub_angle"])
    return recording.replace(channels={**recording.channels, "hub_angle": held})


def residual(
    view: View, prepared: Prepared, model: Model, start: Start, white: bool = True
) -> dict[str, np.ndarray]:
    """Name -> (m) measured minus simulated in noise units; `hub_torque` is the unmodelled torque on the hub.

    Where they are `white`, strains have passed the filter of `whitened`, and both strains and torque their `ringing`,
    and stretches in which the noise swells are as quiet as the others.
    """
    motion, required = move(view, prepared, model, start)
    asked = Recording("", view.time, {c: np.zeros(len(view.time)) for c in view.measured})
    parts = {}
    simulated = reported(model, asked.replace(channels=_strains_only(asked)), motion)
    for channel, values in view.measured.items():
        if channel == "motor_torque":
            predicted = _read_torque(view, prepared, model)
        else:
            predicted = low_passed(simulated[channel], GRID)
            if channel in view.holes:
                values = values + _filled(view, channel, simulated[channel], prepared.hub is not None)
        missing = values - predicted
        if prepared.recording.start == "unknown" and channel != "motor_torque":
            # Without a rest at the start the zero of a bridge is not known.
            missing = missing - np.median(missing[view.known[channel]])
        missing = np.where(view.known[channel], missing, 0.0)
        parts[channel] = whitened(missing, view, channel) if white else missing / view.noise[channel]
    if prepared.hub is not None:
        drive_of = _delivered(view, prepared, model)
        missing = unmodelled(view, model, motion, required, drive_of)
        parts["hub_torque"] = np.where(view.sliding, missing / view.noise["hub_torque"], 0.0)
        parts["break_away"] = _break_aways(view, model, motion, required, drive_of)
        parts["departure"], _ = departures.residual(view.time, prepared, model, motion, view.departures)
    if not white:
        return parts
    parts |= {name: r.whitened(parts[name]) for name, r in view.ringing.items()}
    return parts | {name: parts[name] / swell for name, swell in view.swell.items()}


def _filled(view: View, channel: str, simulated: np.ndarray, moving: bool) -> np.ndarray:
    """Change (m) of a filtered strain if its missing readings are as simulated, off by as much as those beside them.

    A filter spreads what bridges a gap to its sides: as simulated, it leaves no trace in what is compared.
    """
    known, off = view.known[channel], view.holes[channel] - simulated
    between = np.interp(view.time, view.time[known], off[known]) if known.any() else off
    change = low_passed(np.where(known, 0.0, between - off), GRID)
    return low_passed(change, GRID, view.band) if moving else change


def whitened(values: np.ndarray, view: View, channel: str) -> np.ndarray:
    """A residual (..., m) in noise units whose noise has the same size at every frequency up to `BAND`.

    The noise of the hub angle shakes the modelled link, which rings at its clamped modes for seconds: there a
    residual means little. Before and behind the recording it is continued as its odd extension.
    """
    share = view.whitening.get(channel)
    if share is None:
        return values / view.noise[channel]
    pad = min(values.shape[-1] - 1, _pad(view))
    before = 2 * values[..., :1] - values[..., pad:0:-1]
    behind = 2 * values[..., -1:] - values[..., -2 : -pad - 2 : -1]
    extended = np.concatenate([before, values, behind], axis=-1)
    white = irfft(rfft(extended) * share, extended.shape[-1])
    return white[..., pad : pad + values.shape[-1]]


def _pad(view: View) -> int:
    return int(_EXTENSION / GRID)


def _whitening(prepared: Prepared, view: View, model: Model) -> dict[str, np.ndarray]:
    """Channel -> gain over frequency that makes the noise of its residual white, unit variance behind the filter."""
    count = len(view.time)
    f = rfftfreq(count + 2 * min(count - 1, _pad(view)), GRID)
    period = prepared.recording.period
    hub = 2 * prepared.noise["hub_angle"] ** 2 * period * passed(f, GRID, view.band) ** 2
    wide = float(np.trapezoid(passed(f, GRID) ** 2, f))
    omega = 2 * np.pi * f
    frequencies, shapes = model.chain.modes("clamped")
    # What rings for longer is for `Ringing`: a filter this sharp would ring as long itself.
    ratios = np.maximum(model.chain.damping_ratios("clamped"), 1 / (ringing.LIGHT * frequencies))
    pushes = model.chain.mass_matrix()[0, 1:] @ shapes[1:]
    found = {}
    for channel, row in model.curvature_rows.items():
        if channel not in view.measured:
            continue
        seen = model.sensors[channel].half_thickness * (row @ shapes[1:]) * pushes
        response = sum(
            size * omega**2 / (w**2 - omega**2 + 2j * z * w * omega)
            for size, w, z in zip(seen, frequencies, ratios, strict=True)
        )
        own = 2 * prepared.noise[channel] ** 2 * period
        found[channel] = 1 / np.sqrt((own + np.abs(response) ** 2 * hub) * wide)
    return found


def move(view: View, prepared: Prepared, model: Model, start: Start) -> tuple[Motion, np.ndarray]:
    """The link under the measured hub, and the torque (m) on the hub that this takes [N m].

    Candidates that act on the hub alone move the link alike: what the link does is kept for a while.
    """
    hub = hub_motion(view, model)
    phi, omega = initial_state(model, prepared.recording, start)
    # What a motor with play does is for `_delivered` to say.
    plant = planar.without_motor(model.plant)
    key = (*link_of(plant), hub.angle.tobytes(), phi.tobytes(), omega.tobytes())
    name = hash((key, model.step))
    if (known := view.moves.get(name)) is None:
        if prepared.recording.start == "unknown":
            omega = omega - omega[0] + hub.rate[0]
        step = model.link_step
        first = planar.extended(plant, phi), planar.extended(plant, omega)
        parts = max(1, round(GRID / model.step))
        fine = planar.driven(plant, *_between(view.time, hub, parts), *first, step)
        known = fine[0][::parts].copy(), fine[1][::parts].copy(), fine[2][::parts].copy()
        for old in list(view.moves)[: max(0, len(view.moves) - _KEPT + 1)]:
            view.moves.pop(old, None)
        view.moves[name] = known
    angles, rates, required = known
    return Motion.of(view.time, angles, rates, hub.direction, len(phi)), required


@dataclass(frozen=True)
class Hub:
    """Motion of the hub behind its sensor (m): angle [rad], rate, acceleration, direction."""

    angle: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    direction: np.ndarray


def hub_motion(view: View, model: Model) -> Hub:
    """What the hub does, as the model of its sensor says."""
    angle = model.hub_angle_of(view.reading, view.time)
    if np.array_equal(angle, view.reading):
        return Hub(angle, view.rate, view.acceleration, view.direction)
    spline = smooth(view.time, angle)
    rate = spline(view.time, 1)
    return Hub(angle, rate, spline(view.time, 2), np.where(view.direction == 0, 0.0, np.sign(rate)))


def _between(time: np.ndarray, hub: Hub, parts: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Instants, angle, rate and acceleration of a hub, with so many parts to each step of the grid.

    The acceleration of a driven link is a straight line from one instant to the next, in which an oscillation is
    (omega h)^2/12 too small. A model with short steps sees it at the end of each, and `limit.move` takes the
    error out of the others.
    """
    if parts == 1:
        return time, hub.angle, hub.rate, hub.acceleration
    finer = np.interp(np.arange(parts * (len(time) - 1) + 1) / parts, np.arange(len(time)), time)
    spline = smooth(time, hub.angle)
    return finer, spline(finer), spline(finer, 1), spline(finer, 2)


_ON_HUB = (
    *("static_positive", "static_negative", "coulomb_positive", "coulomb_negative", "stribeck_velocity"),
    *("friction_amplitude", "friction_order", "friction_phase", "viscous", "lag", "bias"),
    *("cable_stiffness", "cable_rest_angle", "cogging_amplitude", "cogging_order", "cogging_phase"),
    *("disturbance_amplitude", "disturbance_frequency", "disturbance_phase"),
)


def on_link(plant: planar.Plant) -> dict[str, float]:
    """What acts on the link beyond its own inertia, stiffness and damping: fields of the plant."""
    own = ("flexibility", "hub_inertia", *_ON_HUB)
    return {n: v for n, v in plant._asdict().items() if n not in own and not isinstance(v, np.ndarray)}


def link_of(plant: planar.Plant) -> tuple:
    """What the link's motion under a given hub depends on: the plant without the torques on the hub, to be compared."""
    values = [value for name, value in plant._asdict().items() if name not in _ON_HUB]
    return tuple(v.tobytes() if isinstance(v, np.ndarray) else v for v in values)


def unmodelled(
    view: View, model: Model, motion: Motion, required: np.ndarray, delivered: np.ndarray
) -> np.ndarray:
    """Torque (m) on the hub that the model does not account for [N m], where the hub slides."""
    return low_passed(twice_averaged(required) - hub_laws(view, model, motion), GRID) - delivered


def near_reversals(view: View) -> np.ndarray:
    """Whether the hub turns round within the filter's memory of an instant (m)."""
    turned = np.diff(np.signbit(view.rate), prepend=np.signbit(view.rate[0]))
    return binary_dilation(turned, iterations=round(1 / BAND / GRID))


def hub_laws(view: View, model: Model, motion: Motion) -> np.ndarray:
    """Torque (m) of all hub laws and sliding friction along a motion [N m].

    Friction is its mean over a grid step, in which the hub may turn round, behind the filter of the motion.
    """
    resting = _laws(view, model, motion, np.zeros(len(view.time)))
    return resting + low_passed(_sliding_friction(view, model, motion), GRID, view.band)


def _sliding_friction(view: View, model: Model, motion: Motion) -> np.ndarray:
    """Torque (m) of sliding friction [N m], its mean over a grid step.

    The filter of the motion rounds off what friction does to the hub where it turns round, and one that falls with the
    speed hangs on that: what the filter has taken is put back, as far as friction has made it.
    """
    angle, rate, inertia = motion.angles[:, 0], motion.rates[:, 0], model.chain.free_hub_inertia()

    def at(rate: np.ndarray) -> np.ndarray:
        mean = planar.mean_friction(model.plant, angle, rate, np.gradient(rate))
        return np.where(motion.modes == 0, 0.0, mean)

    friction, taken = at(rate), np.zeros(len(rate))
    for _ in range(_ROUNDS - 1 if model.plant.stribeck_velocity > 0 else 0):
        pushed = np.cumsum(friction) * GRID / inertia
        taken = (taken + pushed - low_passed(pushed, GRID, view.band)) / 2
        friction = at(rate + taken)
    return friction


def _laws(view: View, model: Model, motion: Motion, direction: np.ndarray) -> np.ndarray:
    """Torque (m) of all hub laws [N m], friction that of a hub that slides in a direction (m), 0 where that is 0."""
    return planar.hub_laws(model.plant, view.time, motion.angles[:, 0], motion.rates[:, 0], direction)


def _break_aways(
    view: View, model: Model, motion: Motion, required: np.ndarray, delivered: np.ndarray
) -> np.ndarray:
    """Torque that friction bore at a break-away less the static level, in noise units (m), at the break-aways.

    The filter smears the break-away over the instants before it: a parabola through the rest that went before is
    followed up to it.
    """
    parts = np.zeros(len(view.time))
    if not view.onsets:
        return parts
    laws = _laws(view, model, motion, np.zeros(len(parts)))
    borne = delivered + low_passed(laws - required, GRID)
    for k, direction in view.onsets:
        before = slice(k - int(_APPROACH / GRID), k - int(_SMEAR / GRID))
        t = view.time[before] - view.time[k] + _BLIND
        slope_of = np.polyfit(t, borne[before] * direction, 2)
        level = planar.static_level(model.plant, motion.angles[k, 0], direction)
        # The instant is known to some 3 ms, the torque to its noise, the parabola to some percent of the level.
        sigma = np.hypot(np.hypot(1.5 * view.noise["hub_torque"], 0.003 * slope_of[1]), _TRUST * level)
        parts[k] = (slope_of[2] - level) / sigma
    return parts


def _well_defined(
    onsets: Sequence[tuple[int, int]], stuck: np.ndarray, command: np.ndarray
) -> tuple[tuple[int, int], ...]:
    """Break-aways (index on the grid, direction) out of a long rest under a command that does not jump."""
    found = []
    for k, direction in onsets:
        first = k - int(_APPROACH / GRID)
        if first < 0 or not stuck[first : k - int(_SMEAR / GRID)].all():
            continue
        approach = command[first : max(first + 1, k - 2)]
        if np.abs(np.diff(approach)).max() < 0.02 * np.abs(approach).max():
            found.append((k, direction))
    return tuple(found)


def _delivered(view: View, prepared: Prepared, model: Model) -> np.ndarray:
    """Torque (m) that reaches the hub, on the grid, filtered [N m]: what the drive delivers, or a play passes on."""
    torque = mean_torque(model, prepared.recording, view.time)
    if model.plant.gap > 0:
        hub = hub_motion(view, model)
        torque = planar.transmitted(model.plant, view.time, hub.acceleration, hub.angle, torque)
    # The measured motion has passed one low-pass more than the torque.
    return low_passed(low_passed(torque, GRID, view.band), GRID)


def _read_torque(view: View, prepared: Prepared, model: Model) -> np.ndarray:
    """Delivered torque as a current sensor reports it, at the samples, filtered like the reading."""
    recording = prepared.recording
    read = model.report(recording.time, {"motor_torque": model.read_torque(recording)})["motor_torque"]
    return low_passed(np.interp(view.time, recording.time, read), GRID)


def _strains_only(asked: Recording) -> dict[str, np.ndarray]:
    return {c: v for c, v in asked.channels.items() if c != "motor_torque"}


def motion_band(
    recording: Recording, noise: float, time: np.ndarray, bands: Sequence[float] = MOTION_BANDS
) -> float:
    """The widest of the bands in which the strongest accelerations stand out of their noise [Hz]."""
    reading = low_passed(on_grid.resampled(recording, "hub_angle", time)[0], GRID, bands[-1])
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
    return _FIRM * model.declared["static_friction"] / model.chain.free_hub_inertia()


def _may_stick(
    rate: np.ndarray, acceleration: np.ndarray, noise: float, period: float, band: float, grip: float
) -> np.ndarray:
    """Samples (m) about reversals and slow stretches at which the hub may have stuck for a moment.

    A stick has neither rate nor acceleration, but a short one is lost between the motion before it and behind it: there
    was none where the acceleration stands out of its noise and is more than friction can hold.
    """
    slow = np.abs(rate) < 3 * noise * _gain(band, period, 1)
    return slow & (np.abs(acceleration) < max(_SURE * noise * _gain(band, period, 2), grip))


def _sensor_noise(prepared: Prepared, hub: dict[str, float]) -> dict[str, float]:
    share = np.sqrt(2 * BAND * prepared.recording.period)
    noise = {c: prepared.noise[c] * min(1.0, share) for c in prepared.channels if c != "hub_angle"}
    return {name: float(np.hypot(value, hub.get(name, 0.0))) for name, value in noise.items()}


def _propagated(prepared: Prepared, view: View, model: Model) -> tuple[dict[str, float], np.ndarray]:
    """Noise of each channel, and noise (m) of the torque on the hub [N m]: a simulation with noise added to the hub."""
    plain, torque = move(view, prepared, model, prepared.start)
    noisy = _shaken(view, prepared, np.random.default_rng(0), np.ones(len(view.time)))
    moved, torque_moved = move(noisy, prepared, model, prepared.start)
    asked = Recording(
        "", view.time, {c: np.zeros(len(view.time)) for c in view.measured if c != "motor_torque"}
    )
    a, b = reported(model, asked, plain), reported(model, asked, moved)
    hub = {c: float(np.std(low_passed(a[c] - b[c], GRID))) for c in asked.measured()}
    return _sensor_noise(prepared, hub), low_passed(torque_moved - torque, GRID)


def _shaken(view: View, prepared: Prepared, generator: np.random.Generator, where: np.ndarray) -> View:
    """The view with noise added to the hub, a share (m) of it at each instant."""
    sigma = prepared.noise["hub_angle"] * min(1.0, np.sqrt(prepared.recording.period / GRID))
    shaken = low_passed(generator.normal(0, sigma, len(view.time)), GRID, view.band) * where
    spline = smooth(view.time, shaken)
    return replace(
        view,
        moves={},
        reading=view.reading + shaken,
        rate=view.rate + spline(view.time, 1),
        acceleration=view.acceleration + spline(view.time, 2),
    )


def _swell(view: View, prepared: Prepared, model: Model) -> dict[str, np.ndarray]:
    """Name -> (m) size of the noise, in that of the quiet stretches.

    All else takes what noise of the hub angle does to the link as the same throughout. A link that bends far answers to
    it several times as loudly, at other frequencies than those at which it rings: noises are tried.
    """
    moving = view.direction != 0
    if not moving.any():
        return {}
    generator = np.random.default_rng(1)
    plain = residual(view, prepared, model, prepared.start)
    squares = {name: np.zeros(len(view.time)) for name in view.ringing}
    for _ in range(_DRAWS):
        noisy = residual(_shaken(view, prepared, generator, moving), prepared, model, prepared.start)
        squares = {name: s + (noisy[name] - plain[name]) ** 2 / _DRAWS for name, s in squares.items()}
    known = {**view.known, "hub_torque": view.sliding}
    return {name: _swelling(s, known[name], moving) for name, s in squares.items()}


def _swelling(squares: np.ndarray, known: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """Size (m) of a unit noise a part of which has these squares (m) about each instant, in that where it is usual."""
    size = 2 * int(_LOCAL / GRID) + 1
    share = uniform_filter1d(known.astype(float), size, mode="constant")
    local = uniform_filter1d(squares * known, size, mode="constant") / np.maximum(share, 1 / size)
    usual = float(np.median(local[known & moving])) if (known & moving).any() else 0.0
    return np.sqrt(1 + np.maximum(local - usual, 0.0))


def _evened(view: View, swings: Sequence[Swing], torque: np.ndarray) -> tuple[float, Ringing]:
    """Standard deviation of noise (m) of the torque without its swings [N m], and these where the hub slides."""
    pulls = np.hstack([np.zeros((len(torque), 0)), *(s.pull * s.coordinate for s in swings)])
    rough = ringing.of_columns(pulls / np.std(torque))
    even = float(np.std(rough.whitened(torque)))
    return even, ringing.of_columns(pulls * view.sliding[:, None] / even)


def _swinging_strains(view: View, model: Model, swings: Sequence[Swing]) -> dict[str, Ringing]:
    """Channel -> the swings that `whitened` leaves in its residual."""
    found = {}
    for channel in view.whitening:
        row = model.sensors[channel].half_thickness * model.curvature_rows[channel]
        seen = [row @ s.shape[1:] * s.coordinate for s in swings]
        columns = whitened(np.hstack([np.zeros((len(view.time), 0)), *seen]).T, view, channel).T
        found[channel] = ringing.of_columns(columns * view.known[channel][:, None])
    return found


class DrivenData:
    """The views of some recordings as residuals for a fit."""

    def __init__(self, prepared: Sequence[Prepared], model: Model, bands: Sequence[float] = MOTION_BANDS):
        self.prepared = tuple(prepared)
        self.views = tuple(look(p, model, bands) for p in self.prepared)
        self.groups, self.weight = self._layout()
        self.blocks = evidence.blocks(self.groups, self.weight, int(BLOCK / GRID))

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """See `residual`."""
        return residual(self.views[i], self.prepared[i], model, start)

    def counts(self) -> np.ndarray:
        """Number of independent samples of each block (g): the filter leaves two a hertz and second."""
        per_sample = min(1.0, 2 * BAND * GRID)
        return np.array(
            [self.weight[g.rows].sum() * (1.0 if g.channel in SINGLE else per_sample) for g in self.blocks]
        )

    def _layout(self) -> tuple[tuple[Group, ...], np.ndarray]:
        groups, weights, row = [], [], 0
        for i, (view, p) in enumerate(zip(self.views, self.prepared, strict=True)):
            late = view.time >= view.time[0] + (_SETTLING if p.recording.start == "unknown" else 0.0)
            if p.hub is not None:
                late &= view.time <= view.time[-1] - _LAST
            named = {c: view.known[c] & late for c in view.measured}
            if p.hub is not None:
                named["hub_torque"] = view.sliding & late
                at_onset = np.zeros(len(view.time), dtype=bool)
                at_onset[[k for k, _ in view.onsets if 0 < k < len(at_onset)]] = True
                named["break_away"] = at_onset
                named["departure"] = view.departing & late
            for channel, mask in named.items():
                if mask.any() and np.isfinite(list(view.noise.values())).all():
                    groups.append(Group(i, channel, slice(row, row + len(mask))))
                    weights.append(mask.astype(float))
                    row += len(mask)
        return tuple(groups), np.concatenate(weights) if weights else np.zeros(0)
