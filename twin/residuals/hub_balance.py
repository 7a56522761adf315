"""The balance of torques on a hub whose motion is measured: what drive, friction and all else leave of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import binary_dilation

from twin.mechanics import planar
from twin.mechanics.state import Motion
from twin.residuals import backlash, stribeck_reversals
from twin.residuals.cell_means import mean_torque, twice_averaged
from twin.residuals.filters import BAND, GRID, low_passed
from twin.residuals.prepared import Prepared
from twin.residuals.view import LEFT_OUT, View, before_end
from twin.rigs.model import Model

_APPROACH, _SMEAR = 0.3, 0.06  # s before a break-away between which the torque on the resting hub is read
_TRUST = 0.05  # relative error of a break-away torque that is read this way
_BLIND = 0.004  # s from a break-away to the first visible motion


def unmodelled(
    view: View, model: Model, motion: Motion, required: np.ndarray, delivered: np.ndarray
) -> np.ndarray:
    """Torque (m) on the hub that the model does not account for [N m], where the hub slides and is read."""
    left = twice_averaged(required) - hub_laws(view, model, motion) - delivered
    # Behind that, a filter has taken a motion that goes on for its mirror image: a blow of many noise levels.
    read = before_end(view.time, model.hub_late + LEFT_OUT / 2)
    return low_passed(np.where(read, left, 0.0), GRID)


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
    """Torque (m) of sliding friction [N m], its mean over a grid step."""
    if model.plant.friction.stribeck_velocity > 0:
        return stribeck_reversals.along(view, model, motion)
    angle, rate = motion.angles[:, 0], motion.rates[:, 0]
    mean = planar.mean_friction(model.plant, angle, rate, np.gradient(rate))
    return np.where(motion.modes == 0, 0.0, mean)


def _laws(view: View, model: Model, motion: Motion, direction: np.ndarray) -> np.ndarray:
    """Torque (m) of all hub laws [N m], friction that of a hub that slides in a direction (m), 0 where that is 0."""
    return planar.hub_torque_along(
        model.plant, view.time - view.time[0], motion.angles[:, 0], motion.rates[:, 0], direction
    )


def break_aways(
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
    borne = low_passed(delivered + laws - required, GRID)
    for k, direction in view.onsets:
        before = slice(k - int(_APPROACH / GRID), k - int(_SMEAR / GRID))
        t = view.time[before] - view.time[k] + _BLIND
        slope_of = np.polyfit(t, borne[before] * direction, 2)
        level = planar.static_level(model.plant, motion.angles[k, 0], direction)
        # The instant is known to some 3 ms, the torque to its noise, the parabola to some percent of the level.
        sigma = np.hypot(np.hypot(1.5 * view.noise["hub_torque"], 0.003 * slope_of[1]), _TRUST * level)
        parts[k] = (slope_of[2] - level) / sigma
    return parts


def well_defined(
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


def delivered(view: View, prepared: Prepared, model: Model) -> np.ndarray:
    """Torque (m) that reaches the hub, on the grid, behind the filter of the motion [N m].

    It is what the drive delivers, or a play passes on.
    """
    if model.plant.motor.gap > 0:
        torque = backlash.passed_on(view, prepared, model)
    else:
        torque = mean_torque(model, prepared.recording, view.time)
    return low_passed(torque, GRID, view.band)


def read_torque(view: View, prepared: Prepared, model: Model) -> np.ndarray:
    """Delivered torque as a current sensor reports it, at the samples, filtered like the reading."""
    recording = prepared.recording
    read = model.report(recording.time, {"motor_torque": model.read_torque(recording)})["motor_torque"]
    return low_passed(np.interp(view.time, recording.time, read), GRID)
