"""Which motions the recordings of a campaign hold: fast parts, free decays, rests, both directions of the hub."""

from __future__ import annotations

import numpy as np

from twin.campaigns import check_rig
from twin.campaigns.campaign import Campaign
from twin.campaigns.readings import estimate_noise
from twin.campaigns.rests import classify_hub_motion
from twin.mechanics.planar import STUCK
from twin.parameters import Rig
from twin.recording import Recording

_FAST_SHARE = 1e-3
"""Least share of the command's power above half the first mode's frequency [1]: a slew with a step has a hundred times
this, a sine below a tenth of that frequency none."""
_DECAY_PERIODS = 5.0
"""Periods of the first mode over which the command is held, so that a damping ratio of a few percent shows."""
_HELD = 0.01  # of the command's range, within which it counts as held
_HOLD_STEP = 0.01
"""Time over which a command that changes by no more than that share is held [s]: a sine above 0.3 Hz is not."""
_REST = 0.2  # s, least rest of the hub from which a break-away is seen


def fast_parts(campaign: Campaign) -> list[str]:
    """Names of the recordings whose command excites bending."""
    return [r.name for r in _driven(campaign) if _fast_share(r, campaign.rig) >= _FAST_SHARE]


def decays(campaign: Campaign) -> list[str]:
    """Names of the recordings in which the link rings down freely: after a release, or under a held command."""
    found = []
    for recording in _all(campaign):
        span = _DECAY_PERIODS * check_rig.vibration_period(recording, campaign.rig)
        if recording.initial_tip_deflection is not None or _longest_hold(recording) >= span:
            found.append(recording.name)
    return found


def rests(campaign: Campaign) -> list[str]:
    """Names of the recordings in which the hub rests, and moves before or after."""
    return [r.name for r in _driven(campaign) if _rests_and_moves(campaign, r)]


def rest_spans(campaign: Campaign, recording: Recording) -> tuple[tuple[float, float], ...]:
    """(begin, end) of each rest of a free hub from which a break-away is seen [s]; none without its angle."""
    if recording.clamped or not _has_hub(recording):
        return ()
    return _rest_spans(recording, _observed(campaign, recording))


def _has_hub(recording: Recording) -> bool:
    """Whether the hub angle has readings."""
    return "hub_angle" in recording and bool(np.isfinite(recording["hub_angle"]).any())


def _rest_spans(recording: Recording, observed: np.ndarray) -> tuple[tuple[float, float], ...]:
    resting = np.r_[0, (observed == STUCK).astype(int), 0]
    begins, ends = np.flatnonzero(np.diff(resting) == 1), np.flatnonzero(np.diff(resting) == -1)
    spans = zip(recording.time[begins], recording.time[ends - 1], strict=True)
    return tuple((float(begin), float(end)) for begin, end in spans if end - begin >= _REST)


def directions(campaign: Campaign) -> set[int]:
    """Directions, +1 and -1, in which the hub moves in some recording."""
    observed = [_observed(campaign, r) for r in _driven(campaign)]
    return {int(side) for states in observed for side in np.unique(states) if side in (1, -1)}


def at_the_limit(campaign: Campaign) -> dict[str, float]:
    """Name -> share of the samples whose command is at the amplifier's limit or beyond [1], where any is."""
    limit = campaign.rig["torque_limit"]
    if not np.isfinite(limit):
        return {}
    shares = {r.name: float(np.mean(np.abs(r["torque_command"]) >= limit)) for r in _all(campaign)}
    return {name: share for name, share in shares.items() if share > 0}


def _all(campaign: Campaign) -> tuple[Recording, ...]:
    return (*campaign.fit, *campaign.holdout())


def _driven(campaign: Campaign) -> list[Recording]:
    """Fit recordings with a free hub whose angle is measured: those in which anything is looked for."""
    return [r for r in campaign.fit if not r.clamped and _has_hub(r)]


def _fast_share(recording: Recording, rig: Rig) -> float:
    time = np.arange(recording.time[0], recording.time[-1], recording.period)
    command = np.interp(time, recording.time, recording["torque_command"])
    power = np.abs(np.fft.rfft(command - command.mean())) ** 2
    if not power.sum() > 0:
        return 0.0
    frequencies = np.fft.rfftfreq(len(time), recording.period)
    fast = frequencies >= 0.5 / check_rig.vibration_period(recording, rig)
    return float(power[fast].sum() / power.sum())


def _longest_hold(recording: Recording) -> float:
    """Longest time over which the command is held after it has changed [s]."""
    # Of a dense recording the change from one sample to the next would be small in any motion.
    every = slice(None, None, max(1, round(_HOLD_STEP / recording.period)))
    command, time = np.asarray(recording["torque_command"])[every], recording.time[every]
    changes = np.flatnonzero(np.abs(np.diff(command)) > _HELD * max(float(np.ptp(command)), 1e-12))
    if not changes.size:
        return 0.0
    instants = np.r_[time[changes + 1], recording.time[-1]]
    return float(np.max(np.diff(instants)))


def _observed(campaign: Campaign, recording: Recording) -> np.ndarray:
    noise = campaign.sensors["hub_angle"].noise or estimate_noise(recording["hub_angle"])
    return classify_hub_motion(recording, max(noise, 1e-12)).observed


def _rests_and_moves(campaign: Campaign, recording: Recording) -> bool:
    observed = _observed(campaign, recording)
    return bool(_rest_spans(recording, observed)) and bool(np.isin(observed, (1, -1)).any())
