"""Static friction of the hub at break-aways under slowly rising torques."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.stats import norm

from twin.campaigns.rests import ONSET_LEVEL, ONSET_SAMPLES, SAMPLES_BEFORE_ONSET
from twin.identification.break_away_events import BreakAway, find_break_aways
from twin.identification.estimates import Estimate, pooled
from twin.mechanics.planar import STUCK
from twin.mechanics.state import Start
from twin.residuals.data import DrivenData
from twin.residuals.prepared import Prepared
from twin.residuals.static_levels import level_readings
from twin.rigs.model import Model

_LINK_TORQUE_ERROR = 0.03  # relative standard deviation of the modelled link's torque on the hub [1]
_REST, _END = 0.3, 0.06
"""Times before a break-away [s] from which, and until which, the hub has to rest without doubt; the command must not
step after the first."""
_MAX_LINK_SHARE = 0.1  # share of the break-away torque that the link may contribute: it has to be quiet [1]
_STAIR_SEARCH = 0.8  # s before the first visible motion in which a slow motion may have begun
_MIN_STAIR_RATIO = 0.7  # least ratio of the stair before the break-away to the one of the break-away [1]
_MAX_COMMAND_STEP = 0.02
"""Change of the command between two samples that counts as a step, of its largest value [1]."""


@dataclass(frozen=True)
class StaticFriction:
    """Static friction of each direction.

    Attributes:
      events: the break-aways that were used.
      errors: standard error of the torque of each [N m].
      by_direction: +1 or -1 -> level [N m].
      level: weighted mean over both directions; None without an event.
      angle_spread: standard deviation of the levels over the hub angles of the events [N m]; NaN below three events.
    """

    events: tuple[BreakAway, ...]
    errors: tuple[float, ...]
    by_direction: dict[int, Estimate]
    level: Estimate | None
    angle_spread: float


def static_friction(data: DrivenData, model: Model, starts: Sequence[Start]) -> StaticFriction:
    """Returns the static friction by every slow approach to a break-away.

    Where simulations that begin in the rest follow the hub once it is free (`static_levels`), their level is used: they
    locate the break-away better than the first visible motion does.
    """
    prepared = data.prepared
    simulated = {(r.recording, r.time): r.level for r in level_readings(data, model, starts)}
    all_events = find_break_aways(model, prepared, starts)
    ramps = tuple(e for e in all_events if _ends_slow_ramp(model, prepared[e.recording], e))
    levels = [
        (e.direction * level.value, level.error)
        if (level := simulated.get((e.recording, e.time))) is not None
        else _level_on_ramp(model, prepared[e.recording], e)
        for e in ramps
    ]
    with_ramp = {e.recording for e in ramps}
    stairs = [s for i, p in enumerate(prepared) if i not in with_ramp for s in _staircase_events(model, p, i)]
    events = (
        *(replace(e, torque=torque) for e, (torque, _) in zip(ramps, levels, strict=True)),
        *(event for event, _ in stairs),
    )
    return _summarised(events, (*(error for _, error in levels), *(error for _, error in stairs)))


def _summarised(events: tuple[BreakAway, ...], errors: tuple[float, ...]) -> StaticFriction:
    """Levels by direction and over all events; `errors` are the standard errors of the torques [N m]."""
    torques = [Estimate(abs(e.torque), s) for e, s in zip(events, errors, strict=True)]
    by_direction = {}
    for direction in (1, -1):
        own = [s for e, s in zip(events, torques, strict=True) if e.direction == direction]
        if own:
            by_direction[direction] = pooled(own)
    level = pooled(torques) if torques else None
    spread = float(np.std([s.value for s in torques], ddof=1)) if len(torques) > 2 else math.nan
    return StaticFriction(events, errors, by_direction, level, spread)


def _ends_slow_ramp(model: Model, prepared: Prepared, event: BreakAway) -> bool:
    """Whether before the event the hub rested, the link was quiet and the command grew without a step."""
    time = prepared.recording.time
    before = (time > event.time - _REST) & (time <= event.time)
    if prepared.hub is None or time[0] > event.time - _REST or before.sum() < 3:
        return False
    early = time[before] < event.time - _END
    command = event.direction * model.read_torque(prepared.recording)[before]
    smooth = np.abs(np.diff(command)).max() < _MAX_COMMAND_STEP * np.abs(command).max()
    quiet = abs(event.torque - event.direction * command[-1]) < _MAX_LINK_SHARE * abs(event.torque)
    resting = bool((prepared.hub.observed[before][early] == STUCK).all())
    return resting and bool(quiet and smooth and command[-1] > command[0])


def _level_on_ramp(model: Model, prepared: Prepared, event: BreakAway) -> tuple[float, float]:
    """Torque at which the hub broke away and its standard error [N m].

    Once free, the hub is accelerated by the difference of static and sliding friction. The motion is detected only when
    it exceeds some noise levels; the growth of the torque until then is subtracted. The break-away itself is uniformly
    distributed between two samples.
    """
    time = prepared.recording.time
    period = prepared.recording.period
    driving = max(abs(event.torque) - model.declared["coulomb_friction"], 0.1 * abs(event.torque))
    gain = driving / model.chain.free_hub_inertia()
    delay, spread = _detection_delay(gain * period**2 / prepared.noise["hub_angle"])
    late = (delay - SAMPLES_BEFORE_ONSET + 0.5) * period
    delivered = float(model.read_torque(prepared.recording)[np.searchsorted(time, event.time)])
    of_link = abs(event.torque - delivered)
    timing_error = event.slope * period * math.hypot(spread, 1 / math.sqrt(12))
    return event.torque - event.direction * event.slope * late, math.hypot(
        timing_error, _LINK_TORQUE_ERROR * of_link
    )


def _detection_delay(gain: float) -> tuple[float, float]:
    """Mean and standard deviation of the number of samples from a break-away to its detection.

    A motion is detected at the first of `ONSET_SAMPLES` readings that exceed the noise by `ONSET_LEVEL` standard
    deviations.

    Args:
      gain: acceleration in noise levels per squared sample period.
    """
    n = np.arange(2 + math.ceil(math.sqrt(4 * ONSET_LEVEL / gain)) + ONSET_SAMPLES)
    exceeds = norm.cdf(gain * n**2 / 2 - ONSET_LEVEL)
    runs = sliding_window_view(exceeds, ONSET_SAMPLES).prod(axis=1)
    first = runs * (1 - np.r_[0.0, exceeds[: len(runs) - 1]])
    first /= first.sum()
    n = n[: len(first)]
    mean = float(first @ n)
    return mean, math.sqrt(float(first @ (n - mean) ** 2))


def _staircase_events(model: Model, prepared: Prepared, index: int) -> list[tuple[BreakAway, float]]:
    """Break-aways on a staircase of commands, and their standard errors [N m].

    The level is uniformly distributed between the stair on which the hub still rested and the one on which it moved.
    """
    if prepared.hub is None:
        return []
    time, observed = prepared.recording.time, prepared.hub.observed
    command = model.read_torque(prepared.recording)
    stairs = np.flatnonzero(np.diff(command))
    events: dict[int, tuple[BreakAway, float]] = {}
    for onset, direction in prepared.hub.onsets:
        first = int(np.searchsorted(time, time[onset] - _STAIR_SEARCH))
        before = (time > time[first] - _REST) & (time <= time[first])
        if time[first] - _REST < time[0] or not (observed[before] == STUCK).all():
            continue
        climb = direction * command[first : onset + 1]
        low, high = float(climb[0]), float(climb[-1])
        if (np.diff(climb) >= 0).all() and _MIN_STAIR_RATIO * high < low < high:
            angle, instant = float(prepared.hub.reading[first]), float(time[onset])
            event = BreakAway(direction * (low + high) / 2, direction, angle, index, instant, 0.0)
            # A hub that stops and starts again on one stair gives no second reading.
            stair = int(np.searchsorted(stairs, onset))
            events.setdefault(stair, (event, (high - low) / math.sqrt(12)))
    return list(events.values())
