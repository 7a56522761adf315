"""The static friction of the hub, by slowly rising torques: what it bore at the instants at which it first moved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.stats import norm

from twin.campaigns.rests import BEFORE_ONSET, IN_A_ROW, ONSET
from twin.identification.estimates import Estimate, pooled
from twin.mechanics.planar import STUCK
from twin.mechanics.state import Start
from twin.residuals import breakaway
from twin.residuals.breakaway import BreakAway
from twin.residuals.data import DrivenData
from twin.residuals.prepared import Prepared
from twin.residuals.static_levels import level_readings
from twin.rigs.model import Model

_MODEL = 0.03  # relative standard deviation of what the model says that the link adds to the drive's torque
_REST, _END = (
    0.3,
    0.06,
)  # s before the break-away between which the hub surely rests and the command has no step
_QUIET = 0.1  # share of the torque up to which the link may add to the drive's
_CLIMB = 0.8  # s before the first visible motion in which a slow one may have begun
_LOWEST = 0.7  # of the stair on which the hub moved, that on which it rested at least
_STEP = 0.02  # of the largest command there, above which a change between two samples is a step


@dataclass(frozen=True)
class StaticFriction:
    """Break-aways and the level of each direction.

    Attributes:
      events: each break-away that the recordings show well.
      errors: standard error of the torque of each [N m].
      by_direction: +1 or -1 -> level [N m].
      level: both directions together; None where there is no event.
      angle_spread: standard deviation of the levels over the angles at which they were read [N m]; NaN below three.
    """

    events: tuple[BreakAway, ...]
    errors: tuple[float, ...]
    by_direction: dict[int, Estimate]
    level: Estimate | None
    angle_spread: float


def read(data: DrivenData, model: Model, starts: Sequence[Start]) -> StaticFriction:
    """Reads the static friction from every slow approach to a break-away.

    Where runs from the rest on follow the hub once it is free, they say best when that was.
    """
    prepared = data.prepared
    run = {(r.recording, r.time): r.level for r in level_readings(data, model, starts)}
    all_events = breakaway.find_break_aways(model, prepared, starts)
    ramps = tuple(e for e in all_events if _ends_a_ramp(model, prepared[e.recording], e))
    read_off = [
        (e.direction * told.value, told.error)
        if (told := run.get((e.recording, e.time))) is not None
        else _read(model, prepared[e.recording], e)
        for e in ramps
    ]
    ramped = {e.recording for e in ramps}
    stairs = [s for i, p in enumerate(prepared) if i not in ramped for s in _stairs(model, p, i)]
    events = (
        *(replace(e, torque=torque) for e, (torque, _) in zip(ramps, read_off, strict=True)),
        *(event for event, _ in stairs),
    )
    errors = (*(error for _, error in read_off), *(error for _, error in stairs))
    seen = [Estimate(abs(e.torque), s) for e, s in zip(events, errors, strict=True)]
    by_direction = {}
    for direction in (1, -1):
        mine = [s for e, s in zip(events, seen, strict=True) if e.direction == direction]
        if mine:
            by_direction[direction] = pooled(mine)
    level = pooled(seen) if seen else None
    spread = float(np.std([s.value for s in seen], ddof=1)) if len(seen) > 2 else math.nan
    return StaticFriction(events, errors, by_direction, level, spread)


def _ends_a_ramp(model: Model, prepared: Prepared, event: BreakAway) -> bool:
    """Whether the hub rested for long, the link quiet, and the command grew without a step until it moved."""
    time = prepared.recording.time
    before = (time > event.time - _REST) & (time <= event.time)
    if prepared.hub is None or time[0] > event.time - _REST or before.sum() < 3:
        return False
    sure = time[before] < event.time - _END
    command = event.direction * model.read_torque(prepared.recording)[before]
    even = np.abs(np.diff(command)).max() < _STEP * np.abs(command).max()
    quiet = abs(event.torque - event.direction * command[-1]) < _QUIET * abs(event.torque)
    resting = bool((prepared.hub.observed[before][sure] == STUCK).all())
    return resting and bool(quiet and even and command[-1] > command[0])


def _read(model: Model, prepared: Prepared, event: BreakAway) -> tuple[float, float]:
    """Torque at which the hub broke away and its error [N m].

    Once free it gains speed by what static friction exceeds sliding friction; until it has moved by some noise
    levels nobody sees it, and the torque has grown meanwhile. The break-away itself is anywhere between two samples.
    """
    time = prepared.recording.time
    period = prepared.recording.period
    driving = max(abs(event.torque) - model.declared["coulomb_friction"], 0.1 * abs(event.torque))
    gain = driving / model.chain.free_hub_inertia()
    unseen, spread = _unseen(gain * period**2 / prepared.noise["hub_angle"])
    late = (unseen - BEFORE_ONSET + 0.5) * period
    delivered = float(model.read_torque(prepared.recording)[np.searchsorted(time, event.time)])
    of_link = abs(event.torque - delivered)
    error = math.hypot(event.slope * period * math.hypot(spread, 1 / math.sqrt(12)), _MODEL * of_link)
    return event.torque - event.direction * event.slope * late, error


def _unseen(gain: float) -> tuple[float, float]:
    """Mean and standard deviation of the number of samples in which a break-away is not seen yet.

    The hub has left its rest from the first of a few readings in a row that stand out of the noise.

    Args:
      gain: acceleration in noise levels per sample period squared.
    """
    n = np.arange(2 + math.ceil(math.sqrt(4 * ONSET / gain)) + IN_A_ROW)
    out = norm.cdf(gain * n**2 / 2 - ONSET)
    runs = sliding_window_view(out, IN_A_ROW).prod(axis=1)
    first = runs * (1 - np.r_[0.0, out[: len(runs) - 1]])
    first /= first.sum()
    n = n[: len(first)]
    mean = float(first @ n)
    return mean, math.sqrt(float(first @ (n - mean) ** 2))


def _stairs(model: Model, prepared: Prepared, index: int) -> list[tuple[BreakAway, float]]:
    """Break-aways at a stair of a staircase of commands, and their errors [N m].

    The level lies somewhere between the stair on which the hub still rested and the one on which it moved.
    """
    if prepared.hub is None:
        return []
    time, observed = prepared.recording.time, prepared.hub.observed
    command = model.read_torque(prepared.recording)
    found: dict[tuple[float, float], tuple[BreakAway, float]] = {}
    for onset, direction in prepared.hub.onsets:
        first = int(np.searchsorted(time, time[onset] - _CLIMB))
        before = (time > time[first] - _REST) & (time <= time[first])
        if time[first] - _REST < time[0] or not (observed[before] == STUCK).all():
            continue
        climb = direction * command[first : onset + 1]
        low, high = float(climb[0]), float(climb[-1])
        if (np.diff(climb) >= 0).all() and _LOWEST * high < low < high:
            angle, instant = float(prepared.hub.reading[first]), float(time[onset])
            event = BreakAway(direction * (low + high) / 2, direction, angle, index, instant, 0.0)
            # A hub that stops and goes on the same stair says the same once more.
            found.setdefault((low, high), (event, (high - low) / math.sqrt(12)))
    return list(found.values())
