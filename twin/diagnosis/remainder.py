"""What the model that stands at the end leaves unexplained, and whether it is more than noise."""

from __future__ import annotations

import numpy as np

from twin.diagnosis.state import SearchState, UnnamedFunction
from twin.estimation import loss
from twin.estimation.fit import Fit
from twin.estimation.loss import SOUND
from twin.estimation.workbench import Workbench, known_weights
from twin.recording import HUB
from twin.residuals.data import SINGLE

OWN_ERROR = 2e-3
"""Share of what effects have gained so far that the model's own error, which grows with it, may gain once more."""
LEAST_EVIDENCE = 7.0
"""Log of the odds by which a smooth function has to make the recordings likelier: 1100 to 1. Seven are asked in every
campaign, each as large and as smooth as the recordings like it best: two nulls of some 600 came to 5.1 and 5.5."""
QUIET = 1 / 3
"""Noise levels below which a channel's noise is declared too large to be true."""
UNEXPLAINED = 2.0
"""Noise levels beyond which the worst of a channel's residuals is not explained."""
LEFT = 0.05
"""Share of what a residual was before any effect was adopted that a right effect may leave: its discretisation."""
CHANCE = 3.0  # standard deviations by which the size of so much noise may seem larger than it is
FAR_FROM_CHANCE = 5.0  # the same, of the worst
REPEATED = 2  # recordings in which a channel must not be sound


def unexplained_channels(found: SearchState) -> tuple[str, ...]:
    """Channels that are not explained: those that are `large_residuals`, and the hub where something is `significant_function`."""
    large = large_residuals(found)
    return large if HUB in large or significant_function(found) is None else (*large, HUB)


def significant_function(found: SearchState) -> UnnamedFunction | None:
    """The torque on the hub that is surely a function of one variable, though no effect explains it, if there is one.

    Its evidence has to exceed what chance gives, and what a model gets wrong itself.
    """
    if not found.nameless:
        return None
    best, own_error = found.nameless[0], OWN_ERROR * sum(c.score for c in found.adopted)
    return best if best.evidence > max(LEAST_EVIDENCE, own_error, best.by_chance) else None


def large_residuals(found: SearchState) -> tuple[str, ...]:
    """Channels whose residual exceeds what noise and a right model leave, in several recordings; the worst first."""
    odd = _odd(found)
    needed = min(REPEATED, len(found.bench.prepared))
    worst = {
        channel: float(np.median(list(sizes.values())))
        for channel, sizes in odd.items()
        if len(sizes) >= needed
    }
    return tuple(sorted(worst, key=lambda c: -worst[c]))


def in_one_recording(found: SearchState) -> list[tuple[int, str, float]]:
    """Recordings that leave such a residual in a channel that no other recording finds odd, with its size."""
    repeated = large_residuals(found)
    return [(i, c, s) for c, sizes in _odd(found).items() if c not in repeated for i, s in sizes.items()]


def _odd(found: SearchState) -> dict[str, dict[int, float]]:
    """Channel -> recording -> size of a residual that is not sound, of channels whose worst is not explained."""
    before = residual_sizes(found.benches[0], found.base)
    samples = _independent(found.bench)
    odd: dict[str, dict[int, float]] = {}
    worst: set[str] = set()
    for (recording, channel), size in residual_sizes(found.bench, found.best).items():
        if channel in SINGLE:
            continue
        may_be_left = LEFT * before.get((recording, channel), 0.0)
        more = float(np.sqrt(max(size**2 - may_be_left**2, 0.0)))
        deviation = 1 / np.sqrt(2 * max(samples[recording, channel], 1.0))
        if more > max(SOUND, 1 + CHANCE * deviation):
            odd.setdefault(channel, {})[recording] = more
        if more > max(UNEXPLAINED, 1 + FAR_FROM_CHANCE * deviation):
            worst.add(channel)
    return {channel: sizes for channel, sizes in odd.items() if channel in worst}


def overstated_noise(found: SearchState) -> dict[str, float]:
    """Channel -> size of its residual in declared noise levels, of those that are much quieter than declared."""
    sizes = residual_sizes(found.bench, found.best)
    usual = {
        channel: float(np.median([s for (_, c), s in sizes.items() if c == channel and s > 0] or [1.0]))
        for channel in {c for _, c in sizes} - set(SINGLE)
    }
    return {channel: size for channel, size in sorted(usual.items()) if size < QUIET}


def residual_sizes(bench: Workbench, fit: Fit) -> dict[tuple[int, str], float]:
    """Recording and channel -> size of the residual in noise levels."""
    sizes = loss.group_sizes(fit.residual, bench.data.groups, bench.weight * known_weights(bench, fit))
    return {(g.recording, g.channel): float(s) for g, s in zip(bench.data.groups, sizes, strict=True)}


def _independent(bench: Workbench) -> dict[tuple[int, str], float]:
    """Recording and channel -> number of independent samples, which tell the size of noise to 1/sqrt(2 n)."""
    found = {(g.recording, g.channel): 0.0 for g in bench.data.groups}
    for group, count in zip(bench.groups, bench.count, strict=True):
        found[group.recording, group.channel] += float(count)
    return found
