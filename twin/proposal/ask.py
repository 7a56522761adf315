"""Questions to the user about what the data do not tell; an empty answer leaves a thing open."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TypeVar

from twin.campaigns import units
from twin.campaigns.units import DERIVED_UNITS, TIME
from twin.errors import InputError, checked_number, shown
from twin.parameters import DEFAULTS, PARAMETERS, rig_parameter
from twin.proposal.campaign_text import DRIVE, GAUGE, MEANINGS, drive_keys, motor_unit
from twin.proposal.propose import SIGNS, ChannelProposal, Proposal
from twin.proposal.quantity import Quantity, quantity
from twin.recording import CHANNEL_UNITS

Ask = Callable[[str], str]
"""Shows a question and returns the answer; "" where there is none."""
_Answer = TypeVar("_Answer")
_PLAUSIBLE = {"position": (0.0, 100.0), "half_thickness": (1e-5, 0.1)}
"""Key of a strain gauge -> least and largest value of any bending link [m]: foils of 0.02 mm, booms of 0.2 m."""
_OPEN = "(Enter: leave it open)"


def complete(proposal: Proposal, ask: Ask) -> Proposal:
    """Returns the proposal with what the user answered."""
    channels = dict(_channels(proposal, ask))
    drive = _drive(channels, ask)
    values = _parameters(channels.get("torque_command"), "limit" in drive, ask)
    recordings = tuple(
        replace(
            entry, loop=_choice(f"{entry.path.name}: loop, open or closed [open]? ", ("open", "closed"), ask)
        )
        if not entry.unusable and not entry.is_loop_seen
        else entry
        for entry in proposal.recordings
    )
    return replace(
        proposal,
        channels=channels,
        drive=drive,
        parameters={name: value for name, (value, _) in values.items()},
        uncertainty={name: error for name, (_, error) in values.items() if error is not None},
        recordings=recordings,
    )


# Channels


def _channels(proposal: Proposal, ask: Ask) -> Iterator[tuple[str, ChannelProposal]]:
    taken = set(proposal.channels)
    for name, channel in proposal.channels.items():
        given = name if channel.found.is_sure else _renamed(name, channel, taken, ask)
        if given is None:
            continue
        taken.add(given)
        if given != name:
            unseen = "its sign was not looked at: check it" if given in SIGNS else ""
            channel = replace(channel, gain=None, sign_reason=unseen)
        if not channel.unit or given != name:
            channel = replace(channel, unit=_unit(given, channel, ask), unit_reason="")
        if channel.unit and given != TIME and units.raw_unit(channel.unit):
            channel = _with_gain(given, channel, ask)
        asked = {key: _gauge(given, key, ask) for key in units.gauge_keys(given, channel.unit)}
        yield (
            given,
            replace(channel, gauge={key: value for key, value in asked.items() if value is not None}),
        )


def _renamed(name: str, channel: ChannelProposal, taken: set[str], ask: Ask) -> str | None:
    """The channel of a column whose name does not say it; None for none."""
    column, reason = shown(channel.found.column), channel.found.reason
    known = (TIME, *CHANNEL_UNITS, *DERIVED_UNITS)
    free = [other for other in known if other not in taken]
    what = " (torque, current or voltage)" if name == "torque_command" else ""
    choices = (name, "none", *free)
    question = f"column {column}: {reason}. Which channel is it: {', '.join(choices)} [{name}{what}]? "
    answer = _choice(question, choices, ask)
    return None if answer == "none" else answer


def _choice(question: str, choices: tuple[str, ...], ask: Ask) -> str:
    """One of some words; the first where the answer is empty."""
    answer = ask(question).strip()
    while answer and answer not in choices:
        answer = ask(f"'{shown(answer)}' is none of these. {question}").strip()
    return answer or choices[0]


def _unit(name: str, channel: ChannelProposal, ask: Ask) -> str:
    question = f"{name}, column {shown(channel.found.column)}: unit, such as {', '.join(units.allowed(name))} {_OPEN}? "
    while answer := ask(question).strip():
        try:
            units.scale(name, answer)
            return answer
        except InputError as error:
            question = f"{error}: "
    return ""


def _with_gain(name: str, channel: ChannelProposal, ask: Ask) -> ChannelProposal:
    """The channel of a raw signal with what one volt or ampere of it is; a curvature becomes its unit."""
    what, raw = units.allowed(name)[0], units.raw_unit(channel.unit) or channel.unit
    of = {"torque_command": "at the hub "}.get(name, "")
    other, empty = "", _OPEN
    if units.is_strain(name):
        what, other = "strain", ", or curvature with its unit, such as 0.5 1/m"
    if name == "torque_command":
        empty = "(Enter: by data of the motor, or left open)"
    turned = "; negative, as it counts the wrong way round" if channel.gain else ""
    question = f"{name}: {what} {of}per {raw}{other}{turned}; with its uncertainty, such as ± 10 % {empty}? "

    def checked(answer: Quantity) -> tuple[float, str, float | None]:
        if units.is_strain(name) and answer.unit and units.is_curvature(answer.unit):
            return answer.to("1/m"), "1/m", answer.uncertainty
        si = units.allowed(name)[0]
        per = f"{si}/{raw}"
        target = per if answer.unit and units.convertible(answer.unit, per) else si
        return answer.to(target), channel.unit, answer.uncertainty

    found = _quantity(question, checked, ask)
    if found is None:
        return channel
    gain, unit, error = found
    reason = channel.unit_reason if unit == channel.unit else f"curvature per {channel.unit} of the column"
    return replace(
        channel, gain=gain, is_gain_known=True, gain_uncertainty=error, unit=unit, unit_reason=reason
    )


def _gauge(name: str, key: str, ask: Ask) -> float | None:
    """Place or half thickness of a strain gauge [m]; None where it stays open."""

    def checked(answer: Quantity) -> float:
        low, high = _PLAUSIBLE[key]
        return checked_number(key, answer.to("m"), low, high, "m")

    return _quantity(f"{name}: {key.replace('_', ' ')}, {GAUGE[key]} {_OPEN}? ", checked, ask)


# Drive and parameters


def _drive(channels: Mapping[str, ChannelProposal], ask: Ask) -> dict[str, float]:
    """Keys of the `[drive]` of a DC motor -> value, without its kind; empty where the torque of a command is known."""
    raw = motor_unit(channels)
    if raw is None:
        return {}
    found: dict[str, float] = {}
    for key in drive_keys(raw):
        unit, what = DRIVE[key]
        unit = unit or channels["torque_command"].unit or raw
        told = "" if unit == "1" else f" [{unit}]"
        asked = f"DC motor of the drive: {key.replace('_', ' ')}{told}, {what} {_OPEN}? "

        def checked(given: Quantity, key: str = key, unit: str = unit) -> tuple[float, float | None]:
            return checked_number(key, given.to(unit), 0.0), given.uncertainty

        answer = _quantity(asked, checked, ask)
        if answer is None and key in ("resistance", "torque_constant"):
            return {}
        if answer is not None:
            found[key] = answer[0]
            if answer[1] is not None:
                found[f"{key}_uncertainty"] = answer[1]
    return found


def _parameters(
    command: ChannelProposal | None, limited: bool, ask: Ask
) -> dict[str, tuple[float, float | None]]:
    """Name of a parameter -> its value and relative uncertainty; `limited`: the drive has a limit."""
    found: dict[str, tuple[float, float | None]] = {}
    for name in (*(n for n in PARAMETERS if n not in DEFAULTS), *DEFAULTS):
        if limited and name == "torque_limit":
            continue
        if name == "tip_inertia" and found.get("tip_mass", (0.0, None))[0] == 0:
            continue
        # Of most rigs one friction is known.
        usual = found.get("static_friction") if name == "coulomb_friction" else None
        answer = _parameter(name, not found, usual, command, ask)
        if answer is not None:
            found[name] = answer
    return found


def _parameter(
    name: str,
    is_first: bool,
    usual: tuple[float, float | None] | None,
    command: ChannelProposal | None,
    ask: Ask,
) -> tuple[float, float | None] | None:
    """Value of a parameter and its relative uncertainty; `usual` where the answer is empty."""
    unit = PARAMETERS[name][0]
    volts = name == "torque_limit" and command is not None and command.is_gain_known
    told = "" if unit == "1" else f" [{unit} or {command.unit}]" if volts and command else f" [{unit}]"
    default = usual[0] if usual else DEFAULTS.get(name)
    empty = _OPEN if default is None else f"(Enter: {default:g})"
    example = f"; with unit and uncertainty if you like, such as 0.1 {unit} ± 10 %" if is_first else ""

    def checked(answer: Quantity) -> tuple[float, float | None]:
        if volts and command and answer.unit and units.convertible(answer.unit, command.unit):
            value = answer.to(units.raw_unit(command.unit) or command.unit) * abs(command.gain or 1.0)
        else:
            value = answer.to(unit)
        return rig_parameter(name, value, answer.uncertainty, "").value, answer.uncertainty

    return _quantity(f"{name}{told}, {MEANINGS[name]}{example} {empty}? ", checked, ask) or usual


def _quantity(question: str, checked: Callable[[Quantity], _Answer], ask: Ask) -> _Answer | None:
    """The answer as a checked quantity, asked for again until it is one; None where it is empty."""
    asked = question
    while answer := ask(asked).strip():
        try:
            return checked(quantity(answer))
        except InputError as error:
            asked = f"{error}. {question}"
    return None
