"""A proposal as a commented `campaign.toml`, where a comment says what is not known and needed, and as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from twin.campaigns import units
from twin.campaigns.drive import MOTOR_KINDS
from twin.campaigns.units import TIME
from twin.parameters import ASSUMED_UNCERTAINTY, DEFAULTS, PARAMETERS
from twin.proposal.propose import ChannelProposal, Proposal, RecordingProposal
from twin.recording import ON_LINK

MEANINGS = {
    "length": "from the axis of the hub to the tip: from there to the clamp, and from the clamp to the tip",
    "linear_density": "mass of the link per length",
    "bending_stiffness": "E I of the link: Young's modulus times width times thickness^3 / 12",
    "hub_inertia": "of all that turns with the hub, the motor times the square of its gear ratio, without the link",
    "tip_mass": "payload at the tip; 0 for none",
    "tip_inertia": "of the payload about the tip, not about the hub",
    "damping_ratio": "of every bending mode with the hub free to turn",
    "static_friction": "torque that a resting hub withstands",
    "coulomb_friction": "friction torque on a turning hub",
    "torque_limit": "saturation of the amplifier, both signs, as torque on the hub",
}
"""Parameter -> what it is."""
REQUIRED = tuple(name for name in PARAMETERS if name not in DEFAULTS)
"""Parameters without which a rig cannot be simulated."""
GAUGE = {
    "position": "m along the link from the axis of the hub: from there to the clamp, and from the clamp to the gauge",
    "half_thickness": "m from the neutral axis of the link to the gauge, half the thickness of a strip",
}
"""Key of a strain gauge -> what it is."""
DRIVE = {
    "resistance": ("ohm", "of the winding"),
    "torque_constant": ("N*m/A", "torque of the motor per current"),
    "gear_ratio": ("1", "turns of the motor per turn of the hub; 1 without a gear"),
    "efficiency": ("1", "share of the torque that the gear passes on"),
    "limit": ("", "largest magnitude of the command"),
}
"""Key of `[drive]` -> its unit, "" for that of the command, and what it is."""


def motor_unit(channels: Mapping[str, ChannelProposal]) -> str | None:
    """Returns "V" or "A" of a command of which the torque is not known; None of any other."""
    command = channels.get("torque_command")
    return units.raw_unit(command.unit) if command and command.unit and not command.is_gain_known else None


def drive_keys(raw: str) -> tuple[str, ...]:
    """Returns the keys of the `[drive]` of a command in V or A."""
    return tuple(key for key in DRIVE if raw == "V" or key != "resistance")


def campaign_text(proposal: Proposal) -> str:
    """Returns the text of the file."""
    parts = [
        _head(proposal),
        *(_channel(name, channel) for name, channel in proposal.channels.items()),
        _drive(proposal),
        _missing_channels(proposal),
        _unused(proposal),
        *(_recording(entry, k == 0) for k, entry in enumerate(proposal.recordings)),
    ]
    return "\n\n".join("\n".join(lines) for part in parts if (lines := list(part))) + "\n"


def _head(proposal: Proposal) -> Iterator[str]:
    yield "# Proposed by `twin new` from the files below. Check each line; those that begin with # wait for you."
    yield "format = 1"
    yield f"name = {_quoted(proposal.name)}"
    yield f"rig = {_quoted(proposal.name)}{_behind('no preset: all parameters stand below')}"
    yield ""
    yield "[parameters]"
    for name, (unit, _) in PARAMETERS.items():
        yield _parameter(name, unit, proposal.parameters.get(name))
    yield ""
    yield "[uncertainty]"
    yield "# one standard deviation of each value above, as a share of it: in two of three cases the true value lies"
    yield "# within it"
    for name, assumed in ASSUMED_UNCERTAINTY.items():
        if name in proposal.uncertainty:
            yield f"{name} = {proposal.uncertainty[name]:.3g}"
        else:
            yield f"# {name} = {assumed:g}{_behind('assumed if not given')}"


def _parameter(name: str, unit: str, value: float | None) -> str:
    need = "needed: " if name in REQUIRED else ""
    what = f"{'' if unit == '1' else f'{unit}, '}{MEANINGS[name]}"
    if value is not None:
        return f"{name} = {value!r}{_behind(what)}"
    default = "" if name in REQUIRED else f"; {DEFAULTS[name]:g} if not given" if name in DEFAULTS else ""
    return f"# {name} = ...{_behind(f'{need}{what}{default}')}"


def _channel(name: str, channel: ChannelProposal) -> Iterator[str]:
    yield f"[channels.{name}]"
    yield f"column = {_quoted(channel.found.column)}{_behind(channel.found.reason)}"
    if channel.unit:
        yield f"unit = {_quoted(channel.unit)}{_behind(channel.unit_reason)}"
    else:
        likely = ", ".join(_quoted(unit) for unit in units.allowed(name))
        yield f"# unit = ...{_behind(f'needed: {likely}, or another unit of the same quantity')}"
    if name == TIME:
        return
    yield from _gain(name, channel)
    if name in ON_LINK:
        yield "# its zero is fitted in each recording; offset_uncertainty = 0 if it is certain"
    for key in units.gauge_keys(name, channel.unit):
        value = channel.gauge.get(key)
        what = GAUGE[key]
        yield (
            f"# {key} = ...{_behind(f'needed: {what}')}"
            if value is None
            else f"{key} = {value!r}{_behind(what)}"
        )


def _gain(name: str, channel: ChannelProposal) -> Iterator[str]:
    raw = units.raw_unit(channel.unit) if channel.unit else None
    if channel.is_gain_known:
        yield f"gain = {channel.gain!r}{_behind(channel.sign_reason)}"
        if channel.gain_uncertainty is not None:
            yield f"gain_uncertainty = {channel.gain_uncertainty:.3g}"
        elif raw and name == "torque_command":
            yield f"# gain_uncertainty = 0.1{_behind('a share; without it the gain counts as certain')}"
        return
    if raw:
        turned = "negative, " if channel.gain else ""
        drive = f"; or [drive], where {raw} drives a DC motor" if name == "torque_command" else ""
        per = "strain" if units.is_strain(name) else units.allowed(name)[0]
        curved = '; or unit = "1/m" and the curvature per ' + raw if units.is_strain(name) else ""
        yield f"# gain = ...{_behind(f'needed: {turned}{per} per {raw}{drive}{curved}')}"
    if channel.gain is not None and not raw:
        yield f"gain = {channel.gain:g}{_behind(channel.sign_reason)}"
    elif channel.sign_reason:
        yield f"# {channel.sign_reason}"


def needed(proposal: Proposal) -> list[str]:
    """Returns the keys of the file that have no value yet and need one, as a campaign's messages name them."""
    channels = proposal.channels
    keys = [f"parameters.{name}" for name in REQUIRED if name not in proposal.parameters]
    keys += [] if "torque_command" in channels else ["channels.torque_command"]
    keys += [] if {"hub_angle", "motor_angle"} & channels.keys() else ["channels.hub_angle"]
    for name, channel in channels.items():
        if not channel.unit:
            keys.append(f"channels.{name}.unit")
        elif name != TIME and units.raw_unit(channel.unit) and not channel.is_gain_known:
            if name == "torque_command" and proposal.drive:
                continue
            keys.append(f"channels.{name}.gain{' or [drive]' * (name == 'torque_command')}")
        keys += [
            f"channels.{name}.{key}"
            for key in units.gauge_keys(name, channel.unit)
            if key not in channel.gauge
        ]
    return keys


def to_json(proposal: Proposal) -> dict[str, Any]:
    """Returns a proposal as plain values; units SI but for the channels', whose unit is that of the column."""
    channels = {
        name: {
            "column": channel.found.column,
            "unit": channel.unit or None,
            "gain": channel.gain,
            "reasons": [r for r in (channel.found.reason, channel.unit_reason, channel.sign_reason) if r],
        }
        for name, channel in proposal.channels.items()
    }
    recordings = [
        {
            "file": entry.path.name,
            "unusable": entry.unusable or None,
            "role": entry.role,
            "clamped": entry.clamped,
            "start": entry.start,
            "loop": entry.loop,
            "reasons": entry.reasons,
        }
        for entry in proposal.recordings
    ]
    return {
        "name": proposal.name,
        "channels": channels,
        "recordings": recordings,
        "unused": proposal.unused,
        "resonance": proposal.resonance,
        "missing": needed(proposal),
    }


def _drive(proposal: Proposal) -> Iterator[str]:
    """The `[drive]` of a command in V or A of which the torque is not known: as a comment where it was not given."""
    raw = motor_unit(proposal.channels)
    if raw is None:
        return
    mark = "" if proposal.drive else "# "
    if not proposal.drive:
        yield f"# instead of the gain, where {raw} drives a DC motor:"
    yield f"{mark}[drive]"
    yield f'{mark}kind = "{MOTOR_KINDS[raw]}"'
    for key in drive_keys(raw):
        unit, what = DRIVE[key]
        value = proposal.drive.get(key)
        line = f"# {key} = ..." if value is None else f"{key} = {value:.9g}"
        yield f"{line}{_behind(what if unit == '1' else f'{unit or raw}, {what}')}"
        if (error := proposal.drive.get(f"{key}_uncertainty")) is not None:
            yield f"{key}_uncertainty = {error:.3g}"
    if not any(key.endswith("_uncertainty") for key in proposal.drive):
        yield "# each may have its uncertainty, such as efficiency_uncertainty = 0.1, a share; else 10 % of the torque"


def _missing_channels(proposal: Proposal) -> Iterator[str]:
    channels = proposal.channels
    if "torque_command" not in channels:
        yield "# No column is seen to be the command, without which nothing can be diagnosed:"
        yield "# [channels.torque_command]"
        yield '# column = "..."'
        yield '# unit = "..."                 # "N*m", or "V" or "A" with a gain or [drive]'
    if not {"hub_angle", "motor_angle"} & channels.keys():
        yield "# No column is seen to be the angle of the hub:"
        yield "# [channels.hub_angle]"
        yield '# column = "..."'
        yield '# unit = "..."                 # "rad" or "deg"'
    if not any(name.startswith(("strain", "tip")) for name in channels):
        yield "# No column is seen to be a strain or the tip: without one, nothing can be said of the link."


def _unused(proposal: Proposal) -> Iterator[str]:
    if proposal.unused:
        yield "# Columns that are not used:"
        for column, what in proposal.unused.items():
            yield f"#   {_quoted(column)}{f', which {what}' if what else ''}"


_WORDS = {
    "role": '"fit", or "holdout": kept back, to test predictions',
    "loop": '"open" for a prescribed command, "closed" for that of a controller',
    "start": '"rest", or "unknown" for a rig that may move at the first sample',
}
"""Key of a recording -> its words."""


def _recording(entry: RecordingProposal, with_words: bool) -> Iterator[str]:
    lines = ["[[recordings]]", f"file = {_quoted(entry.path.name)}", f"role = {_quoted(entry.role)}"]
    words = _WORDS if with_words else dict.fromkeys(_WORDS, "")
    lines[-1] += _behind(words["role"])
    if entry.clamped:
        lines.append("clamped = true")
    lines.append(f"loop = {_quoted(entry.loop)}{_behind(words['loop'])}")
    lines.append(f"start = {_quoted(entry.start)}{_behind(words['start'])}")
    if entry.unusable:
        yield f"# Not used: {entry.unusable}."
    yield from (f"# {line}" if entry.unusable else line for line in lines)
    for reason in entry.reasons:
        yield f"# {reason}"
    if entry.clamped and entry.start == "unknown":
        yield "# initial_tip_deflection = ...   # m, if the tip was held there and released at the first sample"


def _quoted(text: str) -> str:
    # A JSON string is one of TOML, too.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _behind(text: str) -> str:
    return f"  # {' '.join(text.split())}" if text else ""
