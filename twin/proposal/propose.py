"""A proposal for a campaign: what unknown files seem to hold, and what they do not tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from twin.campaigns import check_channels, units
from twin.campaigns.campaign import STATIC_FILE
from twin.campaigns.units import TIME
from twin.errors import InputError, listed
from twin.files.readers import read_recording
from twin.files.table import Table
from twin.proposal import measure, names, signs
from twin.proposal.assign import Found, by_data, by_name, repeats, time_column
from twin.recording import CHANNEL_UNITS, ON_LINK, Recording

_SPAN = 4.0  # periods of vibration over which signs are looked at, as in `campaigns.check_channels`
_SLIGHT = 0.1  # of the usual swing of the link, below which it says nothing of a locked hub
_TURNS = 7.0  # rad: a hub that turns farther is taken to be read in degrees
SIGNS = {"torque_command": 1, "motor_torque": 1, **dict.fromkeys(signs.BENDING, -1)}
"""Sign of the slow part of a channel per acceleration of the hub: what bends lags behind."""


@dataclass(frozen=True)
class ChannelProposal:
    """A channel.

    Attributes:
      found: its column and why.
      unit: unit of the column; "" where nothing tells it.
      unit_reason: where the unit comes from.
      gain: -1 where the channel counts the wrong way round, None where not, or what the user gave.
      sign_reason: what is known of its sign; "" for a channel without one.
      gauge: position and half thickness of a strain gauge that the user gave [m].
      is_gain_known: whether the user gave the gain.
      gain_uncertainty: its relative standard deviation that the user gave [1]; None where none.
    """

    found: Found
    unit: str
    unit_reason: str
    gain: float | None = None
    sign_reason: str = ""
    gauge: Mapping[str, float] = field(default_factory=dict)
    is_gain_known: bool = False
    gain_uncertainty: float | None = None


@dataclass(frozen=True)
class RecordingProposal:
    """A recording.

    Attributes:
      path: the file, of which the campaign tells the name.
      role, clamped, start, loop: as in `campaign.toml`.
      is_loop_seen: whether the data show the loop.
      reasons: a half sentence for each that the data show, or do not.
      unusable: why it cannot be a recording; "" where it can.
    """

    path: Path
    role: str = "fit"
    clamped: bool = False
    start: str = "rest"
    loop: str = "open"
    is_loop_seen: bool = True
    reasons: tuple[str, ...] = ()
    unusable: str = ""


@dataclass(frozen=True)
class Proposal:
    """What files seem to hold.

    Attributes:
      name: of the campaign.
      channels: name -> channel, `time` first.
      recordings: in the order of the files.
      unused: column -> what it is, perhaps.
      static: file of a static load test; None if there is none.
      resonance: frequency of the largest peak of the link's readings [Hz]; None where none is seen.
      parameters: values that the user gave, SI.
      uncertainty: their relative standard deviations, of those that the user gave.
      drive: keys of a `[drive]` that the user gave, without the kind.
    """

    name: str
    channels: Mapping[str, ChannelProposal]
    recordings: tuple[RecordingProposal, ...]
    unused: Mapping[str, str] = field(default_factory=dict)
    static: Path | None = None
    resonance: float | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    drive: Mapping[str, float] = field(default_factory=dict)


def propose(files: Sequence[Path], name: str) -> Proposal:
    """Returns a proposal for files of one rig.

    Raises:
      InputError: a file cannot be read, or none is a recording.
    """
    tables = {path: read_recording(path, path.name, numeric_only=True) for path in files}
    static = next((path for path in files if path.name == STATIC_FILE), None)
    clocks = {path: time_column(table.columns) for path, table in tables.items() if path != static}
    timed = {path: tables[path] for path, clock in clocks.items() if clock is not None}
    if not timed:
        raise InputError(f"no recording among {listed([path.name for path in files])}: {_why_none(tables)}")
    clock = next(clock for clock in clocks.values() if clock is not None)
    found = _channels(timed, clock)
    channels = {TIME: _time_channel(clock, next(iter(timed.values())))}
    channels |= {f.channel: _unit_proposal(f, timed) for f in found}
    ringing = _resonance(timed, channels)
    channels |= _signs(timed, channels, ringing)
    swings = [_swing(_by_channel(table, channels)) for table in timed.values()]
    entries = [_recording(path, tables[path], clock, channels, float(np.median(swings))) for path in clocks]
    unused = _unused(timed, {c.found.column for c in channels.values()})
    return Proposal(name, channels, _with_roles(entries), unused, static, ringing)


def _why_none(tables: Mapping[Path, Table]) -> str:
    """Why no table is a recording."""
    empty = [path.name for path, table in tables.items() if not len(table)]
    if len(empty) == len(tables):
        return "a header stands in each, and no rows below it; expected samples"
    without = f"; {listed(empty)}: no rows below the header" if empty else ""
    return f"none has a column that increases steadily; expected the time{without}"


def _grids(tables: Mapping[Path, Table], clock: Found) -> list[dict[str, np.ndarray]]:
    """The varying columns of each recording on a grid, of those that at least half of the recordings have."""
    timed = [table for table in tables.values() if clock.column in table.columns]
    count = Counter(name for table in timed for name in table.columns)
    usual = {name for name in count if name != clock.column and 2 * count[name] >= len(timed)}
    return [
        measure.on_grid(
            table.columns[clock.column],
            {name: v for name, v in table.columns.items() if name in usual},
        )
        for table in timed
    ]


def _channels(tables: Mapping[Path, Table], clock: Found) -> list[Found]:
    columns = list(dict.fromkeys(name for table in tables.values() for name in table.header if name))
    varying = [name for name in columns if any(_varies(table, name) for table in tables.values())]
    named = [f for f in by_name([name for name in varying if name != clock.column]) if _plausible(f, tables)]
    return named + by_data(_grids(tables, clock), named)


def _plausible(found: Found, tables: Mapping[Path, Table]) -> bool:
    """Whether a column can be the channel that its name suggests: a supply voltage is no command."""
    if found.channel not in ("torque_command", "motor_torque") or found.is_sure:
        return True
    return any(
        measure.signed(table.columns[found.column])
        for table in tables.values()
        if _varies(table, found.column)
    )


def _varies(table: Table, name: str) -> bool:
    return name in table.columns and bool(np.nanstd(table.columns[name]) > 0)


def _by_channel(table: Table, channels: Mapping[str, ChannelProposal]) -> dict[str, np.ndarray]:
    return {c: table.columns[p.found.column] for c, p in channels.items() if p.found.column in table.columns}


# Units


def _time_channel(clock: Found, table: Table) -> ChannelProposal:
    named = names.unit_of(clock.column, table.units.get(clock.column, ""))
    if named and units.convertible(named, "s"):
        return ChannelProposal(clock, named, "as the file says")
    unit = measure.time_unit(table.columns[clock.column])
    return ChannelProposal(clock, unit or "s", "by the time between two samples")


def _unit_proposal(found: Found, tables: Mapping[Path, Table]) -> ChannelProposal:
    told = next((t.units[found.column] for t in tables.values() if found.column in t.units), "")
    unit = names.unit_of(found.column, told)
    if unit and _suits(found.channel, unit):
        return ChannelProposal(found, unit, "as the file says" if told else "by the name of the column")
    if found.channel in ("torque_command", "motor_torque") and (unit := names.unit_of_drive(found.column)):
        return ChannelProposal(found, unit, "by the name of the column: check it")
    guessed = _guessed_unit(found, tables)
    return ChannelProposal(found, guessed, "by the size of its numbers: check it" if guessed else "")


def _suits(channel: str, unit: str) -> bool:
    try:
        units.scale(channel, unit)
    except InputError:
        return False
    return True


def _guessed_unit(found: Found, tables: Mapping[Path, Table]) -> str:
    """A unit by the size of the numbers; "" where that does not tell it, as of a command."""
    largest = max(
        float(np.nanmax(np.abs(t.columns[found.column]))) for t in tables.values() if _varies(t, found.column)
    )
    if found.channel in ("hub_angle", "hub_reference", "motor_angle", "tip_angle"):
        return "rad" if largest < _TURNS else "deg"
    if units.is_strain(found.channel):
        return "1" if largest < 0.01 else "microstrain" if largest > 10 else ""
    if found.channel == "tip_deflection":
        return "m" if largest < 0.5 else "mm" if largest > 1 else ""
    return {"hub_rate": "rad/s", "tip_acceleration": "m/s^2"}.get(found.channel, "")


# Signs


def _resonance(tables: Mapping[Path, Table], channels: Mapping[str, ChannelProposal]) -> float | None:
    """The median over the recordings of the largest peak of a channel on the link [Hz]."""
    time = channels[TIME]
    columns = [channels[name].found.column for name in ON_LINK if name in channels]
    peaks = [
        measure.resonance(_seconds(table, time), table.columns[column])
        for column in columns[:1]
        for table in tables.values()
        if column in table.columns
        and time.found.column in table.columns
        and measure.moves(table.columns[column])
    ]
    seen = [peak for peak in peaks if peak is not None]
    return float(np.median(seen)) if seen else None


def _seconds(table: Table, time: ChannelProposal) -> np.ndarray:
    stamps = table.columns[time.found.column]
    return units.factor(time.unit, "s") * (stamps - stamps[0])


def _signs(
    tables: Mapping[Path, Table], channels: Mapping[str, ChannelProposal], ringing: float | None
) -> dict[str, ChannelProposal]:
    """The channels with a sign, turned where they go the wrong way with the hub."""
    votes: dict[str, list[float]] = {channel: [] for channel in channels if channel in SIGNS}
    for table in tables.values():
        recording = _turning(table, channels)
        if recording is None:
            continue
        slow = _low_passed(recording, ringing)
        fast = signs.fast(recording, 1 / ringing if ringing else 0.0)
        for channel in votes:
            if channel in recording:
                slope = SIGNS[channel] * _slope(slow, channel) if slow else 0.0
                votes[channel].append(slope or (_fast_sign(fast, channel, recording) if fast else 0.0))
    return {channel: _signed(channels[channel], slopes) for channel, slopes in votes.items()}


def _turning(table: Table, channels: Mapping[str, ChannelProposal]) -> Recording | None:
    """A recording as its columns are; None where its hub does not turn."""
    time, known = channels[TIME], _by_channel(table, channels)
    if time.found.column not in table.columns or "hub_angle" not in known:
        return None
    if not measure.moves(known["hub_angle"]):
        return None
    return Recording("", _seconds(table, time), {c: v for c, v in known.items() if c in CHANNEL_UNITS})


def _low_passed(recording: Recording, ringing: float | None) -> check_channels.LowPassed | None:
    """The recording without its vibrations; None where it is too short or they are not seen."""
    if ringing is None or recording.duration < 6 * _SPAN / ringing:
        return None
    return check_channels.LowPassed(recording, _SPAN / ringing)


def _slope(slow: check_channels.LowPassed, channel: str) -> float:
    """Slow part of a channel per acceleration of the hub; 0 where it is not clear."""
    nuisance = (np.ones_like(slow.acceleration), slow.mean("hub_angle"), slow.rate, slow.direction)
    return slow.slope(channel, nuisance[:2] if channel in signs.BENDING else nuisance)


def _fast_sign(fast: check_channels.LowPassed, channel: str, recording: Recording) -> float:
    """A number of the sign that the fast part of a channel shows, as if it counted right; 0 where it shows none."""
    if channel not in signs.BENDING:
        share = signs.work(fast, channel).share
        return share if abs(share) > signs.CLEAR_WORK else 0.0
    command = recording.channels.get("torque_command", np.zeros(0))
    return signs.bending(fast, channel) if measure.stepwise(command[np.isfinite(command)]) else 0.0


def _signed(channel: ChannelProposal, slopes: Sequence[float]) -> ChannelProposal:
    clear = [slope for slope in slopes if slope]
    if not clear:
        return replace(channel, sign_reason="its sign is not seen in these recordings")
    wrong = sum(slope < 0 for slope in clear)
    if 2 * wrong > len(clear):
        return replace(
            channel,
            gain=-1.0,
            sign_reason=f"it counts the wrong way round in {wrong} of {len(clear)} recordings",
        )
    return replace(
        channel, sign_reason=f"its sign is right in {len(clear) - wrong} of {len(clear)} recordings"
    )


# Recordings


def _swing(columns: Mapping[str, np.ndarray]) -> float:
    """Standard deviation of the first channel on the link; 0 without one."""
    return next((float(np.nanstd(columns[name])) for name in ON_LINK if name in columns), 0.0)


def _recording(
    path: Path, table: Table, clock: Found, channels: Mapping[str, ChannelProposal], usual: float
) -> RecordingProposal:
    """A recording; `usual`: how far the link swings in most recordings."""
    if not len(table):
        return RecordingProposal(path, unusable="it has no rows below its header")
    if clock.column not in table.columns or not measure.steadiness(table.columns[clock.column]):
        return RecordingProposal(path, unusable=f"it has no column {clock.column} that increases steadily")
    columns = _by_channel(table, channels)
    hub = columns.get("hub_angle", columns.get("motor_angle"))
    link = [columns[name] for name in ON_LINK if name in columns]
    swings = any(measure.moves(values) for values in link) and _swing(columns) > _SLIGHT * usual
    clamped = swings and (hub is None or not measure.moves(hub))
    entry = RecordingProposal(path, clamped=clamped, unusable=_lacking(columns, channels, clamped))
    reasons = []
    if clamped:
        still = "there is no hub angle" if hub is None else "the hub stands still"
        reasons.append(f"clamped: {still} while the link swings")
    why = _moving(_seconds(table, channels[TIME]), columns)
    if why:
        entry = replace(entry, start="unknown")
        reasons.append(f"start: {why}")
    loop, seen, reason = _loop(columns)
    if clamped:
        return replace(entry, loop=loop, reasons=tuple(reasons))
    return replace(entry, loop=loop, is_loop_seen=seen, reasons=(*reasons, reason))


def _moving(time: np.ndarray, columns: Mapping[str, np.ndarray]) -> str:
    """Why a rig is not at rest at the first sample; "" where nothing shows it."""
    if moving := measure.moving_first(time, columns):
        return f"{moving} changes at the first sample"
    bent = [c for c in ON_LINK if c in columns and measure.bent_first(columns[c])]
    return f"{bent[0]} begins far from its middle, as that of a bent link" if bent else ""


def _lacking(
    columns: Mapping[str, np.ndarray], channels: Mapping[str, ChannelProposal], clamped: bool
) -> str:
    """Why a recording cannot be used; "" where it can."""
    if not clamped:
        for channel in ("torque_command", "hub_angle"):
            if channel in channels and channel not in columns:
                column = channels[channel].found.column
                return f"it has no column {column} ({channel}), which only a recording with a locked hub may lack"
    return ""


def _loop(columns: Mapping[str, np.ndarray]) -> tuple[str, bool, str]:
    """Whether a controller computed the command, whether that is seen, and how."""
    reference, command = columns.get("hub_reference"), columns.get("torque_command")
    if command is not None and measure.stepwise(command[np.isfinite(command)]):
        return "open", True, "loop: the command is piecewise constant, so it was prescribed"
    if reference is not None and measure.moves(reference):
        return "closed", True, "loop: there is a reference that moves"
    return "open", False, "loop: open or closed cannot be seen from a smooth command: check this"


def _with_roles(entries: Sequence[RecordingProposal]) -> tuple[RecordingProposal, ...]:
    """The recordings, of which some with a free hub are held out: one of three and four, two of more."""
    free = [k for k, entry in enumerate(entries) if not entry.clamped and not entry.unusable]
    held = free[-(1 if len(free) < 5 else 2) :] if len(free) >= 3 else []
    return tuple(replace(entry, role="holdout" if k in held else "fit") for k, entry in enumerate(entries))


def _unused(tables: Mapping[Path, Table], used: set[str]) -> dict[str, str]:
    """Columns that are no channel, with the channel that they may repeat."""
    found: dict[str, str] = {}
    for table in tables.values():
        clock = time_column(table.columns)
        grid = measure.on_grid(table.columns[clock.column], table.columns) if clock else {}
        for name in table.header:
            if name and name not in used and name not in found:
                like = repeats(grid, name, used)
                found[name] = f"repeats {like}" if like else ""
    return found
