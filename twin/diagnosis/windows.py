"""Simulations that begin anew in every window of a recording, from the state that the measured hub gives.

The free run of an integrating rig drifts: a small error of a torque, or one wrong stick, offsets all that follows. In a
window of stated length it is bounded, and shows what the model gets wrong there.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.estimation.first_state import FREE_RUN_SPAN, SPANS
from twin.estimation.output_error import STIFFEST
from twin.estimation.refine import MIN_GAIN
from twin.estimation.workbench import finite
from twin.mechanics import planar
from twin.mechanics.hub_spring import MeasuredHub, spring_of
from twin.mechanics.state import Motion, Start
from twin.recording import Recording
from twin.residuals.filters import GRID, REACH, low_passed
from twin.residuals.make_view import derivative_noise, hub_signals
from twin.residuals.numerics import GAUSS_NEWTON_STEPS, ROUNDING
from twin.residuals.prepared import MIN_READINGS, Prepared, sensor_corrected_start
from twin.residuals.resample import missing_rows
from twin.residuals.residual import has_unknown_zero
from twin.residuals.significance import FOLLOWS, SIGNIFICANT
from twin.residuals.view import SETTLING, Signals, move_link
from twin.rigs.model import Model, with_fine_chain
from twin.rigs.simulate import bending_shapes, delivered_torque, integrate, sensor_readings

WINDOW = FREE_RUN_SPAN
"""Length of a window [s], as of the first one, to which the state of a moving rig is fitted: a few periods of the first
bending mode, short beside the drift of a hub."""
_NEAR = 0.02  # s before and behind the start of a window in which the hub has to be read
_STEP = 0.1  # of difference quotients, in standard deviations of the driven state
_FITTED = ("hub_angle", "hub_rate", "strain_base", "strain_mid", "tip_deflection")
"""Channels to which the state is fitted; an acceleration or a torque says little about it."""


@dataclass(frozen=True, eq=False)
class Windowed:
    """Simulations of a recording in windows; m samples.

    Attributes:
      readings: those of every window, one behind the other; NaN where there is no window.
      window: (m) number of the window in which a sample lies, from 0; -1 where there is none.
    """

    readings: Recording
    window: np.ndarray

    @property
    def inside(self) -> np.ndarray:
        """Whether a sample lies in a window (m)."""
        return self.window >= 0


def simulate_windows(model: Model, prepared: Prepared, start: Start, free: Recording) -> Windowed | None:
    """Free simulations of `WINDOW` each, one behind the other.

    A window predicts: no reading behind its first instant is used but for the low-pass. It begins with the measured
    angle and rate of the hub, low-passed, and with the shape and motion of the modelled link under the measured hub
    until then; the hub sticks where the recording shows a rest. A motor with backlash begins on the flank to which its
    torque pushes it. Near the first sample the low-pass does not know the rate: the first window is that of the free
    run, whose state, of a rig that was moving, is fitted to the first second.

    The rate of a rough hub sensor has an error that is visible within a window. Where the model fits the readings of
    a run-in before the window, from a state as near to the measured one as noise allows, the window
    continues this run: then it shows hardly any error of the state. Where it does not, the measured state is used, or
    that of an observer that follows the run-in better.

    There is no window where the hub is not read about its start, none with missing rows in it or just before, as
    nobody knows the command and the motion there, and none in the rest behind the last whole window.

    Args:
      model: the model; the state is fitted with its chain, and the windows are simulated with a fine one.
      prepared: the recording.
      start: its state at the first sample.
      free: readings of the free run of the whole recording. The first window is its, and the motor torque, which only
        the command decides.

    Returns:
      None where the hub is clamped or not measured, so that nothing is measured to begin with, or without any window.
    """
    if prepared.hub is None:
        return None
    recording = prepared.recording
    channels = {c: np.full(len(recording), np.nan) for c in recording.measured()}
    window, fine = np.full(len(recording), -1), with_fine_chain(model)
    for k, inside, motion in _window_motions(model, prepared, start):
        window[inside] = k
        part = (recording if motion is not None else free).part(inside)
        on_rig = part.replace(channels={c: v for c, v in part.channels.items() if c != "motor_torque"})
        readings = (
            sensor_readings(fine, on_rig, motion, began=recording.time[0]) if motion is not None else on_rig
        )
        for channel in readings.measured():
            channels[channel][inside] = readings[channel]
    if "motor_torque" in channels:
        channels["motor_torque"] = np.where(window >= 0, free["motor_torque"], np.nan)
    return Windowed(recording.replace(channels=channels), window) if (window >= 0).any() else None


def _window_motions(
    model: Model, prepared: Prepared, start: Start
) -> Iterator[tuple[int, np.ndarray, Motion | None]]:
    """Number of each window, its samples as a mask (m), and the motion of the chain at these; None for the free run."""
    recording = prepared.recording
    fine = _Runs(with_fine_chain(model), prepared, start)
    coarse = _Runs(model, prepared, start)
    since = (recording.time - recording.time[0]) / WINDOW
    read, gaps = recording.time[np.isfinite(recording["hub_angle"])], missing_rows(recording)
    for k in range(int(since[-1] + ROUNDING)):
        row, inside = round(k * WINDOW / GRID), np.floor(since + ROUNDING) == k
        begin = recording.time[0] + k * WINDOW
        unseen = any(first < begin + WINDOW and last + SETTLING > begin for first, last in gaps)
        if unseen or inside.sum() < MIN_READINGS or not (np.abs(read - fine.driven.time[row]) < _NEAR).any():
            continue
        if k == 0:
            yield k, inside, None
            continue
        run, row, shift = _start(coarse, fine, row)
        yield k, inside, run.run(row, recording.time[inside], shift)


class _Runs:
    """Motions of a model along a recording, from which free runs branch off.

    Attributes:
      driven: the link driven by the measured hub, low-passed.
    """

    def __init__(self, model: Model, prepared: Prepared, start: Start):
        assert prepared.hub is not None
        self._signals = hub_signals(prepared, prepared.hub, model)
        self._start = start
        motion, _ = move_link(self._signals, prepared, model, start)
        self.driven = _Run(model, prepared, self._signals, motion)

    @functools.cached_property
    def observed(self) -> _Run:
        """A simulation whose hub a spring pulls to the measured one: an observer; turned to the measured angle."""
        run, signals = self.driven, self._signals
        hub = run.motion.angles[:, 0]
        spring = spring_of(run.model.plant, *STIFFEST), MeasuredHub(REACH, GRID, hub, run.motion.rates[:, 0])
        start = sensor_corrected_start(run.model, run.prepared, self._start)
        motion = integrate(run.model, run.prepared.recording, start, spring=spring, instants=run.time)
        turned = (hub - low_passed(motion.angles[:, 0], GRID, signals.band))[:, None]
        angles, extra = motion.angles + turned, motion.extra + turned
        moved = replace(motion, angles=angles, extra=extra, modes=run.motion.modes)
        return _Run(run.model, run.prepared, signals, moved)

    @functools.cached_property
    def _observed_rates(self) -> tuple[np.ndarray, np.ndarray]:
        """Rate of the observed hub within the band of the low-pass less the measured one, and beyond the band (g)."""
        observed, measured = self.observed.motion.rates[:, 0], self.driven.motion.rates[:, 0]
        within = low_passed(observed, GRID, self._signals.band)
        return within - measured, observed - within

    def may_be_observed(self, began: int, row: int) -> bool:
        """Whether the rate of the observed hub may be nearer to the true one at a row than the measured rate.

        Within the band of the low-pass the measured rate is right, whatever the model. The observed one agrees with it
        there, within the error of the measured one, or is off less than it moves beyond the band since another row.
        """
        off, beyond = self._observed_rates
        agrees = np.abs(off[row]) < self.driven.scale[1]
        return bool(agrees or np.sum(off[began:row] ** 2) < np.sum(beyond[began:row] ** 2))


class _Run:
    """A motion of the modelled link along a recording, from which free runs branch off.

    A shift of a state (6) is that of hub angle [rad], hub rate [rad/s], and of the tip deflections by the first two
    clamped modes [m] and their rates [m/s].

    Attributes:
      time: instants (g) at which a free run can begin [s].
      motion: at these.
      scale: (6) standard deviation of the error of a driven state, by noise of the hub angle.
    """

    def __init__(self, model: Model, prepared: Prepared, signals: Signals, motion: Motion):
        self.model, self.prepared = model, prepared
        self.time, self.motion = signals.time, motion
        self.plant, self.times, self.torques = delivered_torque(model, prepared.recording)
        self.drive, self.shapes = model.drive(prepared.recording), bending_shapes(model.chain)
        angle = prepared.noise["hub_angle"]
        rate = angle * derivative_noise(signals.band, prepared.recording.period, 1)
        length = model.rig["length"]
        # Errors of the model add to those of noise.
        self.scale = SIGNIFICANT * np.array([angle, rate, *2 * [length * angle], *2 * [length * rate]])

    def run(self, row: int, instants: np.ndarray, shift: np.ndarray) -> Motion:
        """The free motion at instants (m) [s], from the shifted state at a row of the grid on."""
        began = float(self.time[row])
        delivered = float(self.drive.at(np.array([began]))[0])
        phi, omega, mode = self._state(row, shift, delivered)
        held = _commands_from(self.times, self.torques, delivered, began)
        angles, rates, modes = planar.simulate(
            self.plant, *held, np.r_[began, instants], phi, omega, mode, False, self.model.stable_step
        )
        links = len(self.model.chain.lengths)
        return Motion.from_coordinates(instants, angles[1:], rates[1:], modes[1:], links)

    def _state(self, row: int, shift: np.ndarray, torque: float) -> tuple[np.ndarray, np.ndarray, int]:
        """Angles and rates (n + 1 + k) at a row, shifted, and the mode of the hub; `torque` of the motor [N m]."""
        angles, rates = (values[row] for values in self.motion.state())
        phi, omega = self.plant.extend_state(angles), self.plant.extend_state(rates)
        if len(angles) < len(phi):  # the motion is one without the motor
            phi = self.plant.on_flank(phi, torque)
        hinges = self.shapes.shape[0]
        phi[1 : hinges + 1] += np.cumsum(self.shapes @ shift[2:4])
        omega[1 : hinges + 1] += np.cumsum(self.shapes @ shift[4:6])
        mode = int(self.motion.modes[row])
        if mode != 0:
            mode = int(np.sign(omega[0] + shift[1])) or mode
        phi += shift[0]
        omega += shift[1] if mode != 0 else -omega[0]
        return phi, omega, mode

    def readings(
        self, instants: np.ndarray, motion: Motion, channels: Sequence[str]
    ) -> dict[str, np.ndarray]:
        """Channel -> what its sensor reads of a motion at instants (m)."""
        blank = Recording("", instants, {c: np.zeros(len(instants)) for c in channels})
        began = self.prepared.recording.time[0]
        return dict(sensor_readings(self.model, blank, motion, began=began).channels)


def _start(coarse: _Runs, fine: _Runs, row: int) -> tuple[_Run, int, np.ndarray]:
    """The motion from which the run of a window branches off, at which row of the grid, and the shift of the state (6).

    Args:
      coarse: with which the state is fitted.
      fine: with which it is simulated.
      row: at which the window begins.
    """
    began, shift = _fitted_start(coarse.driven, row)
    off = _residuals_before(fine.driven, began, shift, row)
    if not _follows(off) and fine.may_be_observed(_longest_run_in(row), row):
        earlier, other = _fitted_start(coarse.observed, row)
        if _mean_square(_residuals_before(fine.observed, earlier, other, row)) < _mean_square(off):
            return fine.observed, earlier, other
    return fine.driven, began, shift


def _fitted_start(run: _Run, row: int) -> tuple[int, np.ndarray]:
    """Row from which on the model follows the readings until another row, and the shift of the state there (6)."""
    for span in reversed(SPANS):
        began = row - round(span / GRID)
        shift = _fitted_shift(run, began, row) if began >= 0 else None
        if shift is not None:
            return began, shift
    return row, np.zeros(len(run.scale))


def _longest_run_in(row: int) -> int:
    """Row at which the longest run-in before another row begins."""
    return max(row - round(SPANS[-1] / GRID), 0)


def _residuals_before(run: _Run, began: int, shift: np.ndarray, row: int) -> list[np.ndarray]:
    """Residuals of each fitted channel before a row, at most in the longest of `SPANS`; none without readings.

    They are of what branches off at an earlier row in a shifted state, or at the begin of this span where nothing does.
    """
    first = began if began < row else _longest_run_in(row)
    readings_off = _misfit_between(run, first, row)
    return readings_off(shift / run.scale) if readings_off else []


def _follows(residuals: Sequence[np.ndarray]) -> bool:
    """Whether a model follows its readings, given the residuals of each channel."""
    return all(np.mean(off**2) < FOLLOWS**2 for off in residuals)


def _mean_square(residuals: Sequence[np.ndarray]) -> float:
    """Mean square of the residuals of all channels."""
    return float(np.mean(np.concatenate(residuals) ** 2))


def _fitted_shift(run: _Run, row: int, until: int) -> np.ndarray | None:
    """Shift (6) of the state at a row, fitted to the readings before another row by Gauss-Newton steps.

    It is a Bayesian estimate, `run.scale` its prior. A hub that sticks or a play makes the misfit discontinuous: the
    steps end where one does not lower it. None if the model does not follow the readings then.
    """
    readings_off = _misfit_between(run, row, until)
    if readings_off is None:
        return None
    count = len(run.scale)
    free = np.delete(np.arange(count), [1] if run.motion.modes[row] == 0 else [])
    x, now = np.zeros(count), readings_off(np.zeros(count))
    likeliest, least, follows = x, np.inf, False
    for _ in range(GAUSS_NEWTON_STEPS):
        r = np.concatenate(now)
        moved = [np.concatenate(readings_off(x + step)) for step in _STEP * np.eye(count)[free]]
        J = (np.column_stack(moved) - r[:, None]) / _STEP
        x = x.copy()
        x[free] -= np.linalg.solve(J.T @ J + np.eye(len(free)), J.T @ r + x[free])
        now = readings_off(x)
        cost = sum(float(off @ off) for off in now) + float(x @ x)
        if cost > least - 2 * MIN_GAIN:
            break
        likeliest, least, follows = x, cost, _follows(now)
    return likeliest * run.scale if follows else None


def _misfit_between(run: _Run, row: int, until: int) -> Callable[[np.ndarray], list[np.ndarray]] | None:
    """Function from a shift (6) of the state at a row, in units of its scale, to the residuals of each fitted channel.

    None where no channel has readings between the two rows.
    """
    recording = run.prepared.recording
    inside = (recording.time >= run.time[row] - ROUNDING) & (recording.time < run.time[until] - ROUNDING)
    channels = [
        c for c in _FITTED if c in run.prepared.channels and np.isfinite(recording[c][inside]).sum() > 1
    ]
    instants = recording.time[inside]
    known = {c: np.isfinite(recording[c][inside]) for c in channels}

    def misfit(x: np.ndarray) -> list[np.ndarray]:
        simulated = run.readings(instants, run.run(row, instants, x * run.scale), channels)
        return [_off(run, c, (recording[c][inside] - simulated[c])[known[c]]) for c in channels]

    return misfit if channels else None


def _off(run: _Run, channel: str, known: np.ndarray) -> np.ndarray:
    """Residuals of a channel (k) in multiples of its noise, without their mean where its zero is unknown."""
    has_zero = has_unknown_zero(run.model, run.prepared, channel)
    return finite((known - known.mean() if has_zero else known) / run.prepared.noise[channel])


def _commands_from(
    times: np.ndarray, torques: np.ndarray, delivered: float, began: float
) -> tuple[np.ndarray, np.ndarray]:
    """Instants [s] and torques [N m] held from an instant on, when the drive has reached the torque `delivered`."""
    held = int(np.searchsorted(times, began + ROUNDING, side="right")) - 1
    later = slice(held + 1, None)
    return np.r_[-np.inf, began, times[later]], np.r_[delivered, torques[held], torques[later]]
