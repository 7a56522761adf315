"""When commands act: on which clock a card holds them, and how late within a sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import numpy as np

from twin import driven, fit, observe
from twin.fit import Fit, Prepared, Workbench
from twin.model import Model
from twin.recording import Recording

Clock = Literal["stamped", "mean", "earliest"]
"""When commands are held: at their time stamps, or on the uniform clock about which these scatter."""

_UNIFORM: tuple[Clock, ...] = ("mean", "earliest")
_SURE = 3.0  # standard errors from which commands are said to act late


def on_best_clock(
    recordings: Sequence[Recording], noise: Mapping[str, float], model: Model, pool: ThreadPoolExecutor
) -> tuple[Clock, tuple[Prepared, ...], list[str]]:
    """Decides on which clock a jittered card put out its commands, by which one the declared model fits best."""
    options: dict[Clock, list[Recording]] = {"stamped": [r.replace() for r in recordings]}
    if any(observe.clock(r.time) is not None for r in recordings):
        options |= {name: [on_clock(r, name) for r in recordings] for name in _UNIFORM}
    best, cost = next(iter(options)), np.inf
    kept: tuple[Prepared, ...] = ()
    notes: list[str] = []
    for name, candidates in options.items():
        pairs = [fit.prepare(r, noise) for r in candidates]
        prepared = tuple(p for p, _ in pairs)
        value = 0.0
        if len(options) > 1:
            bench = Workbench(driven.DrivenData(prepared, model), pool)
            [r] = bench.residuals([(model, [p.start for p in prepared], None)])
            value = bench.cost(r)
        if value < cost:
            best, cost, kept = name, value, prepared
            notes = [note for _, said in pairs for note in said]
    if best != "stamped":
        notes.append(
            "Time stamps scatter about a uniform clock; commands are taken to be held on that clock."
        )
    return best, kept, notes


def on_clock(recording: Recording, clock: Clock) -> Recording:
    """The recording with its commands held on this clock."""
    ticks = observe.clock(recording.time)
    if clock == "stamped" or ticks is None:
        return recording
    early = float(np.min(recording.time - ticks)) if clock == "earliest" else 0.0
    return recording.replace(command_time=ticks + early)


def said(found: Fit) -> list[str]:
    """What a fit found of the instant within a sample at which commands act, where it is surely off its stamp."""
    for u, value, error in zip(found.unknowns, found.values, found.errors, strict=True):
        if u.owner == "clock" and abs(value) > _SURE * error:
            return [f"Commands are taken to act {1e3 * value:+.2f} ms off their time stamps."]
    return []
