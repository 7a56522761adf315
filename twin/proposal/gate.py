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
from twin.proposal import measure
from twin.recording import ON_LINK, Recording

_FEWEST_PER_PERIOD = 10.0
"""Samples per period of the first mode: the second, some three times faster, then has three."""
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
    """

    what: str
    ok: bool
    text: str


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
        _rests(recordings),
        *_missing(campaign),
        *(Finding("data", False, note) for note in dict.fromkeys(notes)),
    ]


def to_json(name: str, findings: list[Finding]) -> dict[str, object]:
    """Returns the findings as the content of a JSON file."""
    return {"campaign": name, "findings": [{"what": f.what, "ok": f.ok, "text": f.text} for f in findings]}


def _follows(campaign: Campaign, recordings: tuple[Recording, ...]) -> Finding:
    free = [recording for recording in recordings if not recording.clamped]
    ratios = [
        check_channels.clear_ratios(r, campaign.sensors, campaign.rig).get("torque_command") for r in free
    ]
    clear = [ratio for ratio in ratios if ratio is not None]
    if not clear:
        text = "in no recording does the hub speed up slowly enough beside its vibrations to see it follow the command"
        return Finding("hub, command", False, text)
    middle = float(np.median(clear))
    text = (
        f"in {len(clear)} of {len(free)} recordings the torque per acceleration is {min(clear):.2g} to "
        f"{max(clear):.2g} times the declared inertia"
    )
    return Finding("hub, command", 1 / _INERTIA_FACTOR < middle < _INERTIA_FACTOR, text)


def _rate(campaign: Campaign, recordings: tuple[Recording, ...]) -> Finding:
    samples = {r.name: check_rig.vibration_period(r, campaign.rig) / r.period for r in recordings}
    worst = min(samples, key=lambda name: samples[name])
    text = f"{samples[worst]:.0f} samples per period of the first mode at least, in {worst}"
    return Finding("rate", samples[worst] >= _FEWEST_PER_PERIOD, text)


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
        "rest", False, f'something moves at the first sample of {listed(moving)}; is start = "unknown"?'
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
