"""An effect goes before a function without a name that explains no more.

What is small may be too little to be told from a model's own error by its size, and yet be a smooth function of one
variable wherever that comes back. Then something is missing for sure, and which of the two it is, is a matter of how
much likelier they make the recordings, each number that was fitted at its price: those of an effect, and how large and
how smooth a function is.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

from twin.diagnosis import candidates, contest, remainder, rules
from twin.diagnosis.state import SearchState

_FITTED = 2  # numbers that a function was fitted by: its size and its smoothness


def named_instead(found: SearchState) -> SearchState | None:
    """What was found with the effect that explains as much as the function that has no name; None without one.

    Args:
      found: all of whose recordings are explained but for such a function, if any.
    """
    smooth = remainder.significant_function(found)
    if smooth is None or remainder.large_residuals(found) or not _left(found):
        return None
    least = max(smooth.evidence - candidates.price(_FITTED, found.bench), found.by_chance[-1])
    # What was not worth adopting was only fitted quickly.
    ranked = contest.fit_to_convergence(found.bench, found.best, found.rounds[-1])
    choice = ranked[0]
    if choice.score < least or rules.gain_without_best_recording(found.bench, found.best, choice) <= 0:
        return None
    bench = copy(found.bench)
    fine = contest.refit_in_fine_limit(bench, choice.fit)
    choice = replace(choice, fit=fine, score=candidates.score_gain(bench, found.best, fine))
    if choice.score < least:
        return None
    bench, seen = contest.refit_with_own_noise(bench, found.best, fine)
    return replace(
        found,
        adopted=(*found.adopted, replace(choice, fit=seen)),
        rounds=(*found.rounds[:-1], (choice, *ranked[1:])),
        thresholds=(*found.thresholds[:-1], least),
        benches=(*found.benches, bench),
        instead=smooth,
    )


def _left(found: SearchState) -> bool:
    """Whether the last round has candidates that were fitted and not adopted."""
    if len(found.rounds) == len(found.adopted) or not found.rounds[-1]:
        return False
    best = found.rounds[-1][0]
    return best.score > 0 and best.effects[-1] in best.fit.model.effects
