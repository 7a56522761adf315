"""Effects that stand for something else together: much is explained, but of neither is it told how large it is.

Two shapes that are wrong may add up to one that is right: a spring and a cogging of two periods a turn to a spring that
gets stiffer, each as large as one likes as long as the other takes it away again. What is right is told well.
"""

from __future__ import annotations

from dataclasses import replace

from twin.diagnosis import contest, revise
from twin.diagnosis.state import SearchState
from twin.effects import REGISTRY
from twin.estimation.fit import Fit

_TOLD = 3.0
"""Standard errors from neutral from which the size of an effect is told; by what one gains they are 7 at least."""


def without_stand_ins(found: SearchState) -> SearchState | None:
    """What was found without the effects that only stand for something else; None where there are none.

    Args:
      found: whose last fit has its errors.
    """
    untold = [name for name in found.names if _size(found.best, name) < _TOLD]
    if len(untold) < 2:
        return None
    found = replace(found, taken_back=tuple(untold))
    names = [name for name in found.names if name not in untold]
    if names:
        effects = {name: found.best.model.effects[name] for name in (*found.known, *names)}
        fitted = revise.refit(found, effects, contest.FULL_ITERATIONS, found.best)
        return revise.rebuild(found, names, fitted)
    return replace(
        found,
        adopted=(),
        rounds=found.rounds[:1],
        thresholds=found.thresholds[:1],
        by_chance=found.by_chance[:1],
        draws=found.draws[:1],
        benches=found.benches[:1],
    )


def _size(best: Fit, name: str) -> float:
    """How far an effect is from neutral, in standard errors, by the best told of the parameters that take it there."""
    effect = REGISTRY[name]
    neutral = effect.neutral(best.model.declared)
    open_ends = {p.name: p.turned(neutral[p.name]) for p in effect.parameters if p.name not in effect.along}
    return max(
        (
            abs(value - open_ends[u.name]) / error if error > 0 else 0.0
            for u, value, error in zip(best.unknowns, best.values, best.errors, strict=True)
            if u.owner == name and u.name in open_ends
        ),
        default=_TOLD,
    )
