"""Clock on which a card outputs its commands: the time stamps, or a uniform clock about which these jitter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from twin.campaigns.readings import sample_clock
from twin.recording import Recording

Clock = Literal["stamped", "mean", "earliest"]
"""Commands are held from their time stamps ("stamped"), from the ticks of the uniform clock about which these jitter
("mean"), or from that clock shifted to the earliest stamp ("earliest")."""


def possible_clocks(recordings: Sequence[Recording]) -> tuple[Clock, ...]:
    """Returns the possible clocks of the commands: the time stamps, and the uniform ones if the stamps jitter."""
    jittered = any(sample_clock(r.time) is not None for r in recordings)
    return ("stamped", "mean", "earliest") if jittered else ("stamped",)


def with_command_clock(recording: Recording, clock: Clock) -> Recording:
    """Returns the recording with its commands held from the ticks of a clock."""
    ticks = sample_clock(recording.time)
    if clock == "stamped" or ticks is None:
        return recording
    early = float(np.min(recording.time - ticks)) if clock == "earliest" else 0.0
    return recording.replace(command_time=ticks + early)


def clock_notes(clock: Clock) -> list[str]:
    """Returns a note for a clock other than the time stamps."""
    if clock == "stamped":
        return []
    return ["Time stamps scatter about a uniform clock; commands are taken to be held on that clock."]
