"""What stands against a fit in the data of a campaign: rate, clock, noise, defects, rests, motion, what is missing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twin.campaigns import check_channels, check_rig, defects
from twin.campaigns.campaign import Campaign
from twin.campaigns.readings import estimate_noise, sample_clock
from twin.errors import listed
from twin.parameters import DEFAULTS
from twin.proposal import measure, motions
from twin.recording import ON_LINK, Recording

_FEWEST_PER_PERIOD = 10.0
"""Samples per period of the first mode: the second, some three times faster, then has three."""
_LEAST_PER_PERIOD = 2.5
"""Samples per period of the first mode, without which its vibration cannot be followed: two, and a margin."""
_NOISE_FACTOR = 3.0  # of the declared noise, by which that of the readings may differ
_INERTIA_FACTOR = 2.0
"""Factor by which torque per acceleration may differ from the declared inertia: friction and springs take a part."""


@dataclass(frozen=True)
class Finding:
    """One line.

    Attributes:
      what: what was looked at.
      ok: whether nothing stands against a fit.
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
        Finding("signs, units", True, "no channel clearly counts the wrong way round or in another unit"),
        _follows(campaign, recordings),
        _rate(campaign, recordings),
        _clock(recordings),
        *_noise(campaign),
        _limit(campaign),
        _rests(recordings),
        *_motions(campaign),
        *_missing(campaign),
        *(Finding("data", False, note) for note in dict.fromkeys(notes)),
    ]


def _follows(campaign: Campaign, recordings: tuple[Recording, ...]) -> Finding:
    free = [recording for recording in recordings if not recording.clamped]
    ratios = [
        check_channels.clear_ratios(r, campaign.sensors, campaign.rig).get("torque_command") for r in free
    ]
    clear = [ratio for ratio in ratios if ratio is not None]
    if not clear:
        text = (
            "sign and size of the command are not checked: no recording has a slow part in which the hub follows it, "
            "such as a slow ramp of the command"
        )
        return Finding("hub, command", False, text)
    middle = float(np.median(clear))
    text = (
        f"in {len(clear)} of {len(free)} recordings the torque per acceleration is {min(clear):.2g} to "
        f"{max(clear):.2g} times the declared inertia"
    )
    ok = 1 / _INERTIA_FACTOR < middle < _INERTIA_FACTOR
    return Finding("hub, command", ok, text, fails=not ok)


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
        yield Finding(
            "noise", ok, f"{channel}: {found:.2g} in the readings, {sensor.noise:.2g} declared (SI)"
        )


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
