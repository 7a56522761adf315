"""Questions to the user about what the data do not tell; an empty answer leaves a thing open."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from twin.campaigns import units
from twin.campaigns.units import DERIVED_UNITS, TIME
from twin.errors import InputError, checked_number, shown
from twin.parameters import PARAMETERS, rig_parameter
from twin.proposal.campaign_text import GAUGE, MEANINGS, REQUIRED
from twin.proposal.propose import ChannelProposal, Proposal
from twin.recording import CHANNEL_UNITS

Ask = Callable[[str], str]
"""Shows a question and returns the answer; "" where there is none."""


def complete(proposal: Proposal, ask: Ask) -> Proposal:
    """Returns the proposal with what the user answered."""
    channels = dict(_channels(proposal, ask))
    parameters = {
        name: value
        for name in (*REQUIRED, "tip_mass", "tip_inertia")
        if (value := _parameter(name, ask)) is not None
    }
    recordings = tuple(
        replace(
            entry, loop=_choice(f"{entry.path.name}: loop, open or closed [open]? ", ("open", "closed"), ask)
        )
        if not entry.unusable and not entry.is_loop_seen
        else entry
        for entry in proposal.recordings
    )
    return replace(proposal, channels=channels, parameters=parameters, recordings=recordings)


def _channels(proposal: Proposal, ask: Ask) -> Iterator[tuple[str, ChannelProposal]]:
    taken = set(proposal.channels)
    for name, channel in proposal.channels.items():
        given = name if channel.found.is_sure else _renamed(name, channel, taken, ask)
        if given is None:
            continue
        taken.add(given)
        if not channel.unit or given != name:
            channel = replace(channel, unit=_unit(given, channel, ask), unit_reason="")
        if units.is_strain(given):
            asked = {
                key: _length(f"{given}: {key.replace('_', ' ')}, {what}? ", ask)
                for key, what in GAUGE.items()
            }
            channel = replace(
                channel, gauge={key: value for key, value in asked.items() if value is not None}
            )
        yield given, channel


def _renamed(name: str, channel: ChannelProposal, taken: set[str], ask: Ask) -> str | None:
    """The channel of a column whose name does not say it; None for none."""
    column, reason = shown(channel.found.column), channel.found.reason
    known = (TIME, *CHANNEL_UNITS, *DERIVED_UNITS)
    free = [other for other in known if other not in taken]
    question = f"column {column} {reason}: which channel, or none [{name}]? "
    answer = _choice(question, (name, "none", *free), ask)
    return None if answer == "none" else answer


def _choice(question: str, choices: tuple[str, ...], ask: Ask) -> str:
    """One of some words; the first where the answer is empty."""
    answer = ask(question).strip()
    while answer and answer not in choices:
        answer = ask(f"'{shown(answer)}' is none of: {', '.join(choices)}. {question}").strip()
    return answer or choices[0]


def _unit(name: str, channel: ChannelProposal, ask: Ask) -> str:
    question = (
        f"{name}, column {shown(channel.found.column)}: unit, such as {', '.join(units.allowed(name))}? "
    )
    while answer := ask(question).strip():
        try:
            units.scale(name, answer)
            return answer
        except InputError as error:
            question = f"{error}: "
    return ""


def _parameter(name: str, ask: Ask) -> float | None:
    unit = PARAMETERS[name][0]
    return _number(
        f"{name} [{unit}], {MEANINGS[name]}? ", ask, lambda value: rig_parameter(name, value, None, "").value
    )


def _length(question: str, ask: Ask) -> float | None:
    return _number(question, ask, lambda value: checked_number("it", value, 0.0, 100.0, "m"))


def _number(question: str, ask: Ask, checked: Callable[[float], float]) -> float | None:
    asked = question
    while answer := ask(asked).strip():
        try:
            return checked(float(answer.replace(",", ".")))
        except InputError as error:
            asked = f"{error}. {question}"
        except ValueError:
            asked = f"'{shown(answer)}' is no number. {question}"
    return None
