"""Which column is which channel: by its name, and where that says nothing, by how the columns follow one another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.campaigns.units import TIME
from twin.proposal import measure, names
from twin.recording import ON_LINK

_REPEATS = 0.999  # correlation of two columns of which one repeats the other
_FOLLOWED = 0.9  # correlation of the hub's angle with its reference
_DELIVERED = 0.9  # correlation of a measured torque with its command
_LEADS = 0.3
"""Least lead of a command: 0 is that of two columns that follow each other, 1 of one that was prescribed."""


@dataclass(frozen=True)
class Found:
    """A column that was taken for a channel.

    Attributes:
      channel: name of the channel.
      column: name of the column.
      reason: why, as a half sentence.
      is_sure: whether its name says so.
    """

    channel: str
    column: str
    reason: str
    is_sure: bool


def time_column(columns: Mapping[str, np.ndarray]) -> Found | None:
    """Returns the column of the time: of those that increase steadily the one that is called so, or the steadiest."""
    steady = {name: steadiness for name, v in columns.items() if (steadiness := measure.steadiness(v))}
    if not steady:
        return None
    best = max(steady, key=lambda name: names.fits(name).get(TIME, 0.0) + steady[name])
    called = names.fits(best).get(TIME, 0.0) > 0
    return Found(TIME, best, "increases steadily" + ("" if called else "; its name does not say so"), called)


def by_name(columns: list[str]) -> list[Found]:
    """Returns the channels whose columns are called so, the best fit first; each column and channel once."""
    fits = [
        (fit, -k, channel, name)
        for k, name in enumerate(columns)
        for channel, fit in names.fits(name).items()
        if channel != TIME
    ]
    found: dict[str, Found] = {}
    for fit, _, channel, name in sorted(fits, reverse=True):
        if channel in found or any(f.column == name for f in found.values()) or fit < names.POSSIBLE - 0.2:
            continue
        found[channel] = Found(channel, name, "by its name", fit >= names.LIKELY - 0.11)
    return list(found.values())


def by_data(grids: Sequence[Mapping[str, np.ndarray]], known: list[Found]) -> list[Found]:
    """Returns further channels by what the columns do, as most recordings have it.

    Args:
      grids: of each recording: column -> (m) values on a uniform grid, those that vary.
      known: channels that are found.
    """
    votes = Counter(
        (found.channel, found.column)
        for grid in grids
        for found in _by_one_recording(grid, known)
        if len(grid) > 1
    )
    made: dict[str, Found] = {}
    for (channel, column), count in votes.most_common():
        if channel not in made and all(found.column != column for found in made.values()):
            reason = f"{_REASONS[channel]}, in {count} of {len(grids)} recordings: check it"
            made[channel] = Found(channel, column, reason, False)
    return list(made.values())


_REASONS = {
    "torque_command": "leads the other columns",
    "motor_torque": "follows the command at once",
    "hub_reference": "looks like the angle of the hub, and has no noise",
    "hub_angle": "is the smoothest, as the angle of a heavy hub is",
    "strain_base": "swings faster than the hub, and most",
    "strain_mid": "swings faster than the hub, and less than another",
}


def _by_one_recording(grid: Mapping[str, np.ndarray], known: list[Found]) -> list[Found]:
    """Channels by what the columns of one recording do.

    The hub's angle is the smoothest, as it integrates the torque; a reference looks like it and has no noise; the
    command leads the others, or has no noise; what follows it at once is the motor's torque; what swings faster is
    on the link.
    """
    used, channels = {found.column for found in known}, {found.channel for found in known}
    rest = [n for n in grid if n not in used and not names.fits(n) and not names.says_something_else(n)]
    made: list[Found] = []

    def take(channel: str, column: str) -> None:
        made.append(Found(channel, column, "", False))
        rest.remove(column)

    if not {"hub_angle", "motor_angle"} & channels and rest:
        smoothest = min(
            rest, key=lambda name: measure.roughness(grid[name]) + measure.computed(grid[name]) / 1e3
        )
        take("hub_angle", next(n for n in rest if measure.alike(grid[n], grid[smoothest]) > _REPEATS))
    hub = next((f.column for f in (*known, *made) if f.channel == "hub_angle"), None)
    if hub is not None and hub in grid:
        likeness = {name: measure.alike(grid[name], grid[hub]) for name in rest}
        rest = [name for name in rest if likeness[name] <= _REPEATS]
        reference = [name for name in rest if likeness[name] > _FOLLOWED and measure.computed(grid[name])]
        if reference and "hub_reference" not in channels:
            take("hub_reference", reference[0])
    if "torque_command" not in channels and rest:
        leads = {name: measure.lead(grid[name], [grid[o] for o in grid if o != name]) for name in rest}
        best = max(rest, key=lambda name: leads[name] + measure.computed(grid[name]))
        if measure.computed(grid[best]) or leads[best] > _LEADS:
            take("torque_command", best)
    command = next((f.column for f in (*known, *made) if f.channel == "torque_command"), None)
    if command is not None and command in grid and "motor_torque" not in channels and rest:
        likeness = {name: measure.alike(grid[name], grid[command]) for name in rest}
        if likeness[best := max(rest, key=lambda name: likeness[name])] > _DELIVERED:
            take("motor_torque", best)
    if not set(ON_LINK) & channels:
        largest = sorted(rest, key=lambda name: -float(np.std(grid[name])))
        for channel, column in zip(("strain_base", "strain_mid"), largest, strict=False):
            take(channel, column)
    return made


def repeats(grid: Mapping[str, np.ndarray], column: str, used: set[str]) -> str | None:
    """Returns the used column that a column repeats, in another unit perhaps; None if there is none."""
    if column not in grid:
        return None
    others = (other for other in grid if other in used and other != column)
    return next((o for o in others if measure.alike(grid[column], grid[o]) > _REPEATS), None)
