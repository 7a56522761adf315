"""The error budget in words: what calibration and each effect take away of an error, and what is left."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from twin import labels
from twin.diagnosis.error_budget import ChannelBudget, ModelError
from twin.diagnosis.windows import WINDOW
from twin.recording import MEASURED

_VISIBLE = 0.01
"""Share of the error before a step up to which its change is not told [1]."""


@dataclass(frozen=True)
class PooledBudget:
    """Budget of one channel over several recordings: root mean square of the recordings' errors, SI.

    Attributes:
      channel: of the errors.
      in_windows: whether these are errors in windows of `WINDOW`, or of whole free runs.
      effects: in the order of adoption.
      errors: of the declared model, of the calibrated one, and after each effect.
      noise: of the sensor.
    """

    channel: str
    in_windows: bool
    effects: tuple[str, ...]
    errors: tuple[float, ...]
    noise: float

    @property
    def share_by_effects(self) -> float:
        """Share of the error of the calibrated model that the effects take away [1]; negative if they add to it."""
        return 1 - self.errors[-1] / self.errors[1] if self.errors[1] > 0 else 0.0


def sentences(budgets: Sequence[Mapping[str, ChannelBudget]], depends: Sequence[str], held_out: bool) -> str:
    """The budget in a sentence or two; "" where nothing was simulated.

    It is that of the hub angle in windows, where a free run drifts, and says the errors of whole runs beside them.

    Args:
      budgets: of the recordings that evaluate the answer: channel -> budget.
      depends: variables on which unexplained residuals depend, the strongest first.
      held_out: whether the recordings were held out.
    """
    main = main_budget(budgets)
    if main is None:
        return ""
    where = f"in windows of {WINDOW:g} s" if main.in_windows else "over whole runs"
    which = "held-out recordings" if held_out else "the fitted recordings (none was held out)"
    name = labels.with_the(main.channel)
    said = (
        f"On {which}, {where}, {name} is off by {_amount(main, 0)} as declared: {_taken(main)}"
        f"{_left(main, depends)}."
    )
    whole = pooled(budgets, main.channel, in_windows=False) if main.in_windows else None
    if whole is None:
        return said
    before, after = _amount(whole, 0), _amount(whole, -1)
    return f"{said} Over whole runs, in which errors add up, it is off by {before} before and {after} after."


def main_budget(budgets: Sequence[Mapping[str, ChannelBudget]]) -> PooledBudget | None:
    """The budget of the first channel that has one: the hub angle where it is measured, in windows where there are."""
    for channel in MEASURED:
        for in_windows in (True, False):
            found = pooled(budgets, channel, in_windows)
            if found is not None:
                return found
    return None


def pooled(
    budgets: Sequence[Mapping[str, ChannelBudget]], channel: str, in_windows: bool
) -> PooledBudget | None:
    """The budget of a channel over the recordings that have it; None without any, or if an error is not finite."""
    rows = [b[channel] for b in budgets if channel in b]
    table = [[_value(error, in_windows) for error in row.models] for row in rows]
    table = [values for values in table if not all(map(math.isnan, values))]
    if not table:
        return None
    errors = tuple(math.sqrt(sum(v**2 for v in column) / len(table)) for column in zip(*table, strict=True))
    if not all(map(math.isfinite, errors)):
        return None
    return PooledBudget(channel, in_windows, tuple(name for name, _ in rows[0].steps), errors, rows[0].noise)


def _value(error: ModelError, in_windows: bool) -> float:
    return error.rms_window if in_windows else error.rms


def _amount(budget: PooledBudget, model: int) -> str:
    return labels.amount(budget.channel, budget.errors[model])


def _taken(budget: PooledBudget) -> str:
    """What calibration and effects take away or add, in their order."""
    names = ("calibration", *(labels.words(name) for name in budget.effects))
    clauses, last = [], ""
    for k, name in enumerate(names):
        taken = budget.errors[k] - budget.errors[k + 1]
        if abs(taken) < _VISIBLE * budget.errors[k]:
            clauses.append(f"{name} changes little")
            last = ""
            continue
        verb = "takes" if taken > 0 else "adds"
        amount = labels.amount(budget.channel, abs(taken))
        clauses.append(
            f"{name} {amount}" if verb == last else f"{name} {verb} {amount}{' away' * (taken > 0)}"
        )
        last = verb
    return ", ".join(clauses)


def _left(budget: PooledBudget, depends: Sequence[str]) -> str:
    """What is left, beside the noise of the sensor, and on what it depends."""
    noise = labels.amount(budget.channel, budget.noise)
    on = f" and depends on {labels.with_the(depends[0])}" if depends else ""
    return f"; {_amount(budget, -1)} is left{on} (sensor noise {noise})"
