"""When commands act: on which clock a card holds them, and how late within a sample."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from twin.campaigns.readings import sample_clock
from twin.recording import Recording

Clock = Literal["stamped", "mean", "earliest"]
"""When commands are held: at their time stamps, or on the uniform clock about which these scatter."""


def possible_clocks(recordings: Sequence[Recording]) -> tuple[Clock, ...]:
    """Clocks on which the card may have put out its commands: their time stamps, unless these scatter about another."""
    jittered = any(sample_clock(r.time) is not None for r in recordings)
    return ("stamped", "mean", "earliest") if jittered else ("stamped",)


def with_command_clock(recording: Recording, clock: Clock) -> Recording:
    """The recording with its commands held on this clock."""
    ticks = sample_clock(recording.time)
    if clock == "stamped" or ticks is None:
        return recording
    early = float(np.min(recording.time - ticks)) if clock == "earliest" else 0.0
    return recording.replace(command_time=ticks + early)


def clock_notes(clock: Clock) -> list[str]:
    """What is said of a clock other than the time stamps."""
    if clock == "stamped":
        return []
    return ["Time stamps scatter about a uniform clock; commands are taken to be held on that clock."]
