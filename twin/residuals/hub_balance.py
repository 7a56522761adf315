"""Torque balance of a hub whose motion is measured: required torque against drive, friction and other hub torques."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import binary_dilation

from twin.mechanics import planar
from twin.mechanics.state import Motion
from twin.residuals import backlash, stribeck_reversals
from twin.residuals.cell_means import double_mean, double_mean_torque
from twin.residuals.filters import BAND, GRID, REACH, low_passed
from twin.residuals.prepared import Prepared
from twin.residuals.resample import resample_torque
from twin.residuals.rest_run import REST_SPAN
from twin.residuals.view import Signals, View, as_read, before_end
from twin.rigs.model import Model

_EXTRAPOLATION_ERROR = 0.05  # relative error of a break-away torque that is read this way
_INVISIBLE = 0.003  # s from a break-away to the first visible motion, and its error


def unmodelled_torque(
    signals: Signals, model: Model, motion: Motion, required: np.ndarray, delivered: np.ndarray
) -> np.ndarray:
    """Torque on the hub that the model does not account for (m) [N m], low-passed, at the instants of the motion.

    Args:
      signals: the recording.
      model: its friction and hub torques.
      motion: of the link under the measured hub.
      required: torque on the hub that this motion requires (m) [N m].
      delivered: double mean of the torque of the drive (m) [N m].
    """
    balance = double_mean(required) - hub_law_torque(signals, model, motion) - delivered
    # Later readings of a late sensor are missing: a filter would take the mirror image for them, many noise levels off.
    read = before_end(signals.time, model.hub_late + REACH / 2)
    return low_passed(np.where(read, balance, 0.0), GRID)


def near_reversals(signals: Signals) -> np.ndarray:
    """Whether the hub reverses within the memory of the filter about an instant (m)."""
    turned = np.diff(np.signbit(signals.rate), prepend=np.signbit(signals.rate[0]))
    return binary_dilation(turned, iterations=round(1 / BAND / GRID))


def hub_law_torque(signals: Signals, model: Model, motion: Motion) -> np.ndarray:
    """Torque of the model's hub laws and of sliding friction along a motion (m) [N m].

    Friction is averaged over a grid step, within which the hub may reverse, and passes the filter of the motion.
    """
    frictionless = _hub_laws(signals, model, motion, np.zeros(len(signals.time)))
    return frictionless + low_passed(_sliding_friction(signals, model, motion), GRID, signals.band)


def _sliding_friction(signals: Signals, model: Model, motion: Motion) -> np.ndarray:
    """Torque of sliding friction on the hub, its mean over a grid step (m) [N m]."""
    if model.plant.rubs_on_motor:
        return np.zeros(len(signals.time))
    if model.plant.friction.stribeck_velocity > 0:
        return stribeck_reversals.friction_torque(signals, model, motion)
    angle, rate = motion.angles[:, 0], motion.rates[:, 0]
    mean = planar.mean_friction(model.plant, angle, rate, np.gradient(rate))
    return np.where(motion.modes == 0, 0.0, mean)


def _hub_laws(signals: Signals, model: Model, motion: Motion, direction: np.ndarray) -> np.ndarray:
    """Torque of all hub laws (m) [N m], friction that of a hub that slides in a direction (m), none where it is 0."""
    return planar.hub_torque_along(
        model.plant, signals.time - signals.time[0], motion.angles[:, 0], motion.rates[:, 0], direction
    )


def break_away_residual(
    view: View, model: Model, motion: Motion, required: np.ndarray, delivered: np.ndarray
) -> np.ndarray:
    """Torque that friction held at break-aways less the static level (m), in standard errors; 0 at other instants.

    The filter smears a break-away over the instants before it, so that a parabola through the rest before these is
    extrapolated to it. Arguments as those of `unmodelled_torque`.
    """
    residual = np.zeros(len(view.time))
    if not view.onsets:
        return residual
    laws = _hub_laws(view, model, motion, np.zeros(len(residual)))
    held = as_read(view.time, model.hub_late, low_passed(delivered + laws - required, GRID))
    for k, direction in view.onsets:
        before = slice(k - int(REST_SPAN / GRID), k - round(REACH / GRID))
        t = view.time[before] - view.time[k] + _INVISIBLE
        parabola = np.polyfit(t, held[before] * direction, 2)
        level = planar.static_level(model.plant, motion.angles[k, 0], direction)
        # Errors of the torque's noise, of the instant and of the extrapolation.
        noise = np.hypot(1.5 * view.noise["hub_torque"], _INVISIBLE * parabola[1])
        residual[k] = (parabola[2] - level) / np.hypot(noise, _EXTRAPOLATION_ERROR * level)
    return residual


def usable_break_aways(
    onsets: Sequence[tuple[int, int]], stuck: np.ndarray, command: np.ndarray
) -> tuple[tuple[int, int], ...]:
    """Break-aways out of a long rest under a command that does not jump.

    Args:
      onsets: index on the grid and direction of break-aways.
      stuck: whether the hub rests (m).
      command: delivered torque (m) [N m].
    """
    usable = []
    for k, direction in onsets:
        first = k - int(REST_SPAN / GRID)
        if first < 0 or not stuck[first : k - round(REACH / GRID)].all():
            continue
        approach = command[first : max(first + 1, k - 2)]
        if np.abs(np.diff(approach)).max() < 0.02 * np.abs(approach).max():
            usable.append((k, direction))
    return tuple(usable)


def delivered_torque(signals: Signals, prepared: Prepared, model: Model) -> np.ndarray:
    """Double mean of the torque that reaches the hub (m) [N m], by the drive or through a backlash.

    It passes the filter of the motion.
    """
    drive, plays = model.drive(prepared.recording), model.plant.motor.gap > 0

    def filtered() -> np.ndarray:
        torque = (
            backlash.transmitted_torque(signals, prepared, model)
            if plays
            else double_mean_torque(drive, signals.time)
        )
        return low_passed(torque, GRID, signals.band)

    return signals.torques.get(backlash.inputs(signals, drive, model) if plays else drive.inputs, filtered)


def torque_reading(signals: Signals, prepared: Prepared, model: Model) -> np.ndarray:
    """Delivered torque as a current sensor reports it, on the grid (m) [N m]."""
    recording = prepared.recording
    read = model.report(recording.time, {"motor_torque": model.read_torque(recording)})["motor_torque"]
    return resample_torque(recording.time, read, recording.period, signals.time)
