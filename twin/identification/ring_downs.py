"""Ring-downs of the clamped link in recordings: the hub locked, or held by its friction."""

from __future__ import annotations

from collections.abc import Sequence

from scipy.ndimage import label

from twin.identification import decay
from twin.identification.decay import Decay
from twin.mechanics.planar import STUCK
from twin.recording import Recording
from twin.residuals.prepared import Prepared

_MAX_FREQUENCY_ERROR = 0.02
"""Relative standard error of the frequency up to which a rest contains a ring-down [1]."""


def clamped_ring_downs(recordings: Sequence[Recording]) -> tuple[Decay, ...]:
    """Returns the decay of each recording with a locked hub that has one."""
    decays = []
    for recording in recordings:
        channel = decay.link_channel(recording)
        if recording.clamped and channel is not None:
            decays.append(decay.fit_ring_down(recording, channel, recording.time[0], recording.time[-1]))
    return tuple(d for d in decays if d is not None)


def ring_downs_at_rest(prepared: Sequence[Prepared]) -> tuple[Decay, ...]:
    """Returns the longest decay of each recording while a free hub rests: its friction clamps the link."""
    decays = []
    for p in prepared:
        channel = decay.link_channel(p.recording)
        if p.hub is None or channel is None:
            continue
        runs, count = label(p.hub.observed == STUCK)
        spans = [p.recording.time[runs == k][[0, -1]] for k in range(1, count + 1)]
        fits = [decay.fit_ring_down(p.recording, channel, first, last) for first, last in spans]
        accurate = [d for d in fits if d is not None and _has_accurate_frequency(d)]
        if accurate:
            decays.append(max(accurate, key=lambda d: len(d.period_centre)))
    return tuple(decays)


def _has_accurate_frequency(ring_down: Decay) -> bool:
    frequency = ring_down.frequency
    return frequency.standard_error < _MAX_FREQUENCY_ERROR * frequency.value
