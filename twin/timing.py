"""When commands act: on which clock a card holds them, and how late within a sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from twin import driven, fit, observe, search
from twin.fit import Fit, Prepared, Workbench
from twin.model import Model
from twin.recording import Recording

OPEN = 0.1
"""Share of a sample period within which the instant of a command is calibration."""

_SURE = 5.0  # gain in log likelihood from which the instant is moved


@dataclass(frozen=True)
class Clock:
    """When commands are held.

    Attributes:
      name: "stamped" at their time stamps; "mean" or "earliest" on the uniform clock about which these scatter.
      late: how much later than that they act [s].
    """

    name: str
    late: float = 0.0

    def later(self, late: float) -> Clock:
        """Returns the clock moved by a time [s]."""
        return replace(self, late=self.late + late)


def on_best_clock(
    recordings: Sequence[Recording], noise: Mapping[str, float], model: Model, pool: ThreadPoolExecutor
) -> tuple[Clock, tuple[Prepared, ...], list[str]]:
    """Decides on which clock a jittered card put out its commands, by which one the declared model fits best."""
    options = {"stamped": [r.replace() for r in recordings]}
    if any(observe.clock(r.time) is not None for r in recordings):
        for name in ("mean", "earliest"):
            options[name] = [on_clock(r, Clock(name)) for r in recordings]
    best, cost = "", np.inf
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
    return Clock(best), kept, notes


def on_clock(recording: Recording, clock: Clock) -> Recording:
    """The recording with its commands held on this clock."""
    ticks = observe.clock(recording.time)
    if clock.name == "stamped" or ticks is None:
        return recording if clock.late == 0 else recording.replace(command_time=recording.time + clock.late)
    early = float(np.min(recording.time - ticks)) if clock.name == "earliest" else 0.0
    return recording.replace(command_time=ticks + early + clock.late)


def lateness(bench: Workbench, base: Fit) -> float:
    """How much later than stamped the commands act [s], where that is within what a card leaves open; else 0.

    When within a sample a card puts its command out is calibration: nobody declares it to a tenth of a sample, and
    nothing that the model lacks follows from it. The slope of the residual with a delay tells it, the declared
    parameters free to give way.
    """
    period = min(float(np.median(np.diff(p.recording.time))) for p in bench.prepared)
    late = OPEN * period
    moved = search.with_effect(base.model, "actuator-delay", {"delay": late})
    [residual] = bench.residuals([(moved, base.starts, None)])
    column = ((residual - base.residual) / late)[:, None]
    for group in bench.data.groups:
        if group.channel == "motor_torque":  # a held torque, read as it changes, says nothing below a sample
            column[group.rows] = 0.0
    if fit.slope_gain(bench, base, column) < _SURE:
        return 0.0
    late = fit.slope_move(bench, base, column)
    return late if abs(late) <= OPEN * period else 0.0
