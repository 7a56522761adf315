"""What changed on a rig since its last campaign: verdict, effects, and parameters beyond their standard errors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from twin import labels
from twin.effects import REGISTRY
from twin.fleet.stored import StoredAnswer, StoredEffect, known
from twin.parameters import PARAMETERS

CHANGED = 3.0
"""Difference of a parameter from which it has changed [standard errors of the difference]: by chance 3 in 1000 do."""
_TURNS = ("phase", "direction")
"""Parameters that repeat after a turn of 2 pi."""


@dataclass(frozen=True)
class Change:
    """One difference from the last campaign of a rig.

    Attributes:
      kind: "verdict", "new", "gone", or of a parameter, "moved".
      what: the verdict, effect, or effect and parameter, or rig parameter.
      before, after: verdicts, or values in `unit`; None for an effect that is new or gone.
      unit: SI unit of the values.
      sigmas: difference of a parameter [standard errors of the difference].
    """

    kind: Literal["verdict", "new", "gone", "moved"]
    what: str
    before: str | float | None = None
    after: str | float | None = None
    unit: str = ""
    sigmas: float | None = None

    @property
    def text(self) -> str:
        """The change in a few words."""
        what = labels.words(self.what).replace(".", ": ")
        match self.kind:
            case "verdict":
                return f"verdict {labels.words(str(self.before))} → {labels.words(str(self.after))}"
            case "new" | "gone":
                return f"{what} is {self.kind}"
        before, after = (labels.number(v, labels.PAGE_DIGITS) for v in (self.before, self.after))  # type: ignore[arg-type]
        shown = f"{before} → {after} {labels.unit(self.unit)}".strip()
        return f"{what} {shown} ({labels.ratio(self.sigmas or math.nan)} σ)"


def changes(before: StoredAnswer, after: StoredAnswer) -> tuple[Change, ...]:
    """Returns what is different in the later of two answers, the most telling first."""
    return (*_verdict(before, after), *_effects(before, after), *_calibrated(before, after))


def _verdict(before: StoredAnswer, after: StoredAnswer) -> Iterator[Change]:
    if before.verdict != after.verdict:
        yield Change("verdict", "verdict", before.verdict, after.verdict)


def _effects(before: StoredAnswer, after: StoredAnswer) -> Iterator[Change]:
    old, new = ({e.name: e for e in answer.effects} for answer in (before, after))
    yield from (Change("new", name) for name in new if name not in old)
    yield from (Change("gone", name) for name in old if name not in new)
    for name in new:
        if name in old:
            yield from _moved_parameters(old[name], new[name])


def _moved_parameters(old: StoredEffect, new: StoredEffect) -> Iterator[Change]:
    for name in new.parameters:
        if name in old.parameters:
            before, after = (
                (known(e.parameters[name]), known(e.standard_errors.get(name))) for e in (old, new)
            )
            what, turns = f"{new.name}.{name}", name in _TURNS
            yield from _moved(what, unit(new.name, name), before, after, turns)


def _calibrated(before: StoredAnswer, after: StoredAnswer) -> Iterator[Change]:
    for name in after.calibrated:
        if name in before.calibrated:
            old, new = (
                (known(p.fitted), known(p.standard_error))
                for p in (before.calibrated[name], after.calibrated[name])
            )
            effect, _, parameter = name.rpartition(".")
            yield from _moved(name, unit(effect, parameter), old, new)


def unit(effect: str, parameter: str) -> str:
    """Returns the unit of a parameter of an effect, or where `effect` is "" of the rig; "" where it is not known."""
    if not effect:
        return PARAMETERS.get(parameter, ("", ()))[0]
    of = REGISTRY[effect].parameters if effect in REGISTRY else ()
    return next((p.unit for p in of if p.name == parameter), "")


def _moved(
    what: str, unit: str, old: tuple[float, float], new: tuple[float, float], turns: bool = False
) -> Iterator[Change]:
    """Yields the change of a parameter, given by value and standard error, if it is beyond the errors of both."""
    away = new[0] - old[0]
    if turns and math.isfinite(away):
        away = math.remainder(away, 2 * math.pi)
    error = math.hypot(old[1], new[1])
    if error > 0 and abs(away) > CHANGED * error:  # False where either is not known
        yield Change("moved", what, old[0], new[0], unit, abs(away) / error)
