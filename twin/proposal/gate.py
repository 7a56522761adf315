"""What would mislead a fit in the data of a campaign: rate, clock, noise, defects, rests, motion, what is missing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass

import numpy as np

from twin import labels
from twin.campaigns import check_channels, check_rig, defects
from twin.campaigns.campaign import Campaign
from twin.campaigns.check_channels import LowPassed
from twin.campaigns.readings import estimate_noise, sample_clock
from twin.errors import listed
from twin.mechanics import beam
from twin.parameters import DEFAULTS
from twin.proposal import measure, motions, signs
from twin.recording import CHANNEL_UNITS, ON_LINK, Recording

_FEWEST_PER_PERIOD = 10.0
"""Samples per period of the first mode: the second, some three times faster, then has three."""
_LEAST_PER_PERIOD = 2.5
"""Samples per period of the first mode, without which its vibration cannot be followed: two, and a margin."""
_NOISE_FACTOR = 3.0  # of the declared noise, by which that of the readings may differ
_INERTIA_FACTOR = 2.0
"""Factor by which torque per acceleration may differ from the declared inertia: friction and springs take a part."""
_STRAIN = "m/m"  # unit of a strain, which is a plain number
_FRICTION_FACTOR = 3.0
"""Factor by which the declared static friction may exceed the largest command that moves the hub: friction is known
badly before it is fitted."""


@dataclass(frozen=True)
class Finding:
    """One line.

    Attributes:
      what: what was looked at.
      ok: whether nothing would mislead a fit.
      text: what was found.
      fails: whether a fit would be misled: the campaign does not pass.
    """

    what: str
    ok: bool
    text: str
    fails: bool = False

    def to_json(self) -> dict[str, object]:
        """Returns it as plain values."""
        return {"what": self.what, "ok": self.ok, "fails": self.fails, "text": self.text}


def look(campaign: Campaign) -> list[Finding]:
    """Returns what was found in a campaign that could be read, whose signs and units thus are not clearly wrong."""
    recordings = (*campaign.fit, *campaign.holdout())
    notes = [*campaign.warnings, *defects.without_defects(recordings, campaign.sensors)[1]]
    return [
        Finding(
            "signs, units",
            True,
            "no slow part of a recording shows a channel that counts the wrong way round or in another unit",
        ),
        *_command(campaign, recordings),
        _rate(campaign, recordings),
        _clock(recordings),
        *_noise(campaign),
        _limit(campaign),
        _rests(recordings),
        *_motions(campaign),
        *_missing(campaign),
        *(Finding("data", False, note) for note in dict.fromkeys(notes)),
    ]


def _command(campaign: Campaign, recordings: tuple[Recording, ...]) -> Iterator[Finding]:
    """What the hub shows of signs and sizes."""
    free = [recording for recording in recordings if not recording.clamped and "hub_angle" in recording]
    driven = [(r, motion) for r in free if (motion := _fast(campaign, r)) is not None]
    share = _share_of_work(campaign, driven)
    prescribed = [(r, motion) for r, motion in driven if r.loop == "open"]
    found = {c: [signs.bending(m, c) for r, m in prescribed if c in r] for c in signs.BENDING}
    bent = {c: clear for c, values in found.items() if (clear := [value for value in values if value])}
    turned = {c for c, values in bent.items() if float(np.median(values)) < 0}
    if share < -signs.CLEAR_WORK:
        yield _against(share, bent.keys(), turned)
    else:
        yield _follows(campaign, free, share > signs.CLEAR_WORK)
        yield from (_link(c, values) for c, values in bent.items())
    yield from _too_weak(campaign, free)


def _fast(campaign: Campaign, recording: Recording) -> LowPassed | None:
    """The recording with its first mode; None where it is too short, or where a released link drives the hub."""
    if recording.initial_tip_deflection is not None:
        return None
    return signs.fast(recording, check_rig.vibration_period(recording, campaign.rig))


def _share_of_work(campaign: Campaign, driven: Sequence[tuple[Recording, LowPassed]]) -> float:
    """Net over gross work of the command on the hub in all recordings [1]; 0 where there is none."""
    net = gross = 0.0
    for recording, motion in driven:
        done = signs.work(motion, "torque_command")
        # A hub that moves at first may give its energy to the drive.
        moving = 0.0 if recording.start == "rest" else motion.first_rate
        net += done.net + 0.5 * beam.rigid_inertia(campaign.rig) * moving**2
        gross += done.gross
    return net / gross if gross > 0 else 0.0


def _against(share: float, bent: Set[str], turned: Set[str]) -> Finding:
    """A command that turns the hub the wrong way; `bent`: channels whose sign is seen, `turned`: those of them against
    the hub."""
    channel = (
        "torque_command or hub_angle" if not bent else "hub_angle" if turned == bent else "torque_command"
    )
    text = (
        f"{channel} counts the wrong way round: the command takes energy out of the rig, {-100 * share:.0f} % of what "
        "it exchanges with the hub, and a rig has none to give; turn the sign of its gain (no gain is a gain of 1)"
    )
    return Finding("hub, command", False, text, fails=True)


def _follows(campaign: Campaign, free: Sequence[Recording], drives: bool) -> Finding:
    """What slow parts show of the size of the command; `drives`: whether its work shows its sign."""
    ratio = check_channels.clear_ratios(free, campaign.sensors, campaign.rig).get("torque_command")
    if ratio is None:
        unchecked = (
            "the sign of the command is right, as it drives the hub; its size is not checked"
            if drives
            else "sign and size of the command are not checked"
        )
        why = "no recording has a slow part in which the hub follows it, such as a slow ramp of the command"
        return Finding("hub, command", False, f"{unchecked}: {why}")
    text = f"the torque per acceleration is {ratio:.2g} times the declared inertia"
    ok = 1 / _INERTIA_FACTOR < ratio < _INERTIA_FACTOR
    return Finding("hub, command", ok, text, fails=not ok)


def _link(channel: str, clear: Sequence[float]) -> Finding:
    """Whether the link bends as the hub accelerates; `clear`: correlations of the recordings that show it."""
    wrong = sum(correlation < 0 for correlation in clear)
    if float(np.median(clear)) > 0:
        text = f"{channel}: its sign is right in {len(clear) - wrong} of {len(clear)} recordings that show it"
        return Finding("hub, link", True, text)
    text = (
        f"{channel} counts the wrong way round in {wrong} of {len(clear)} recordings that show it: at the first mode a "
        "link that is bent towards positive angles turns the hub to them; turn the sign of its gain (no gain is a gain "
        "of 1)"
    )
    return Finding("hub, link", False, text, fails=True)


def _too_weak(campaign: Campaign, free: Sequence[Recording]) -> Iterator[Finding]:
    """A command that never overcomes the declared friction, although the hub moves."""
    moved = [r for r in free if r.initial_tip_deflection is None and measure.moves(r["hub_angle"])]
    if not moved:
        return
    largest = max(float(np.nanmax(np.abs(r["torque_command"]))) for r in moved)
    friction = campaign.rig["static_friction"]
    if largest >= friction:
        return
    travel = max(float(np.nanmax(r["hub_angle"]) - np.nanmin(r["hub_angle"])) for r in moved)
    text = (
        f"the largest command is {largest:.2g} N·m, less than the declared static_friction of {friction:.2g} N·m, and "
        f"yet the hub travels {travel:.2g} rad; check unit and gain of torque_command, and static_friction"
    )
    yield Finding("friction", False, text, fails=_FRICTION_FACTOR * largest < friction)


def _rate(campaign: Campaign, recordings: tuple[Recording, ...]) -> Finding:
    samples = {r.name: check_rig.vibration_period(r, campaign.rig) / r.period for r in recordings}
    worst = min(samples, key=lambda name: samples[name])
    text = f"{samples[worst]:.0f} samples per period of the first mode at least, in {worst}"
    few = samples[worst]
    return Finding("rate", few >= _FEWEST_PER_PERIOD, text, fails=few < _LEAST_PER_PERIOD)


def _clock(recordings: tuple[Recording, ...]) -> Finding:
    jittered = [recording.name for recording in recordings if sample_clock(recording.time) is not None]
    if not jittered:
        return Finding("clock", True, "time stamps are uniform, or follow no uniform clock")
    return Finding("clock", False, f"time stamps scatter about a uniform clock in {listed(jittered)}")


def _noise(campaign: Campaign) -> Iterator[Finding]:
    for channel, sensor in campaign.sensors.items():
        readings = [r[channel] for r in campaign.fit if channel in r and measure.moves(r[channel])]
        if not readings or not sensor.noise:
            continue
        found = float(np.median([estimate_noise(values) for values in readings]))
        ok = 1 / _NOISE_FACTOR < found / sensor.noise < _NOISE_FACTOR
        unit = _STRAIN if CHANNEL_UNITS[channel] == "1" else labels.unit(CHANNEL_UNITS[channel])
        text = f"{channel}: {found:.2g} {unit} in the readings, {sensor.noise:.2g} {unit} declared"
        yield Finding("noise", ok, text)


def _rests(recordings: tuple[Recording, ...]) -> Finding:
    moving = [
        recording.name
        for recording in recordings
        if recording.start == "rest"
        and recording.initial_tip_deflection is None
        and measure.moving_first(recording.time, recording.channels)
    ]
    if not moving:
        return Finding(
            "rest", True, "where a recording is said to start from rest, nothing moves at its first sample"
        )
    return Finding(
        "rest",
        False,
        f'something moves at the first sample of {listed(moving)}; is start = "unknown"?',
        fails=True,
    )


def _limit(campaign: Campaign) -> Finding:
    shares = motions.at_the_limit(campaign)
    if not shares:
        return Finding("saturation", True, "no command reaches the limit of the amplifier")
    most = max(shares, key=lambda name: shares[name])
    text = (
        f"the command reaches torque_limit in {listed(shares)}, in up to {100 * shares[most]:.0f} % of the samples "
        f"of {most}"
    )
    return Finding("saturation", shares[most] < 1, text)


def _motions(campaign: Campaign) -> Iterator[Finding]:
    looked_for = (
        ("fast part", motions.fast_parts, "so that the bending modes show little; record a slew with steps"),
        ("decay", motions.decays, "so that damping shows little; hold the command while the link rings down"),
        (
            "rest of the hub",
            motions.rests,
            "so that no break-away shows; record moves with rests between them",
        ),
    )
    for what, names_of, why in looked_for:
        names = names_of(campaign)
        if names:
            yield Finding(what, True, f"in {listed(names)}")
        else:
            yield Finding(what, False, f"in no recording, {why}")
    if len(motions.directions(campaign)) == 1:
        yield Finding(
            "directions", False, "the hub turns one way only, so that friction the other way does not show"
        )


def _missing(campaign: Campaign) -> Iterator[Finding]:
    recordings = (*campaign.fit, *campaign.holdout())
    if not campaign.holdout():
        yield Finding("missing", False, "no recording is held out, so that no prediction can be tested")
    if not any(recording.clamped for recording in recordings):
        yield Finding("missing", False, "no recording has a locked hub, which shows the link alone")
    if not any(channel in campaign.sensors for channel in ON_LINK):
        yield Finding("missing", False, "no channel is on the link, so that nothing can be said of it")
    parameters = campaign.rig.parameters
    unknown = [n for n, p in parameters.items() if p.uncertainty is None and n not in DEFAULTS]
    if unknown:
        yield Finding("missing", False, f"[uncertainty] of {', '.join(unknown)}; a usual one is assumed")
