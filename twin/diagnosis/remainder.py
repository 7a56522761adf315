"""What the model that stands at the end leaves unexplained, judged by `rules.EXPLANATION`."""

from __future__ import annotations

import numpy as np

from twin.diagnosis.judgement import Judgement, judge_all
from twin.diagnosis.rules import EXPLANATION, LEFT_SHARE, SIZE_DEVIATIONS, Leftover, excesses
from twin.diagnosis.state import SearchState, UnnamedFunction
from twin.estimation import loss
from twin.estimation.fit import Fit
from twin.estimation.loss import ADEQUATE_RMS
from twin.estimation.workbench import Workbench, reversal_weights
from twin.recording import HUB
from twin.residuals.data import EVENT_CHANNELS

QUIET = 1 / 3
"""Noise levels below which a channel's declared noise is too large to be true."""


def judge_channels(state: SearchState) -> dict[str, tuple[Judgement, ...]]:
    """Channel -> what each rule of explanation says of what the model leaves of it."""
    return {channel: judge_all(EXPLANATION, left) for channel, left in _leftovers(state).items()}


def unexplained_channels(state: SearchState) -> tuple[str, ...]:
    """Channels that are not explained: those with `large_residuals`, and the hub with a `significant_function`."""
    large = large_residuals(state)
    return large if HUB in large or significant_function(state) is None else (*large, HUB)


def significant_function(state: SearchState) -> UnnamedFunction | None:
    """The likeliest smooth function of one variable behind the torque on the hub, if it is significant."""
    if not state.unnamed:
        return None
    *_, function = judge_all(EXPLANATION, _with_function(state, Leftover((), (), 0)))
    return None if function.passed else state.unnamed[0]


def large_residuals(state: SearchState) -> tuple[str, ...]:
    """Channels whose residual exceeds what noise and a right model leave, in several recordings; the worst first."""
    medians: dict[str, float] = {}
    for channel, left in _leftovers(state).items():
        worst, repeated, _ = judge_all(EXPLANATION, left)
        if not worst.passed and not repeated.passed:
            sizes = np.asarray(left.sizes)
            medians[channel] = float(np.median(sizes[excesses(left, ADEQUATE_RMS, SIZE_DEVIATIONS) > 1]))
    return tuple(sorted(medians, key=lambda c: -medians[c]))


def in_one_recording(state: SearchState) -> list[tuple[int, str, float]]:
    """Recording, channel and size of each such residual that no other recording shows in that channel."""
    repeated, found = large_residuals(state), []
    recordings = _recordings(state.bench)
    for channel, left in _leftovers(state).items():
        worst, *_ = judge_all(EXPLANATION, left)
        if channel in repeated or worst.passed:
            continue
        for k in np.flatnonzero(excesses(left, ADEQUATE_RMS, SIZE_DEVIATIONS) > 1).tolist():
            found.append((recordings[channel][k], channel, float(left.sizes[k])))
    return found


def overstated_noise(state: SearchState) -> dict[str, float]:
    """Channel -> size of its residual in declared noise levels, of those that are much quieter than declared."""
    sizes = residual_sizes(state.bench, state.best)
    usual = {
        channel: float(np.median([s for (_, c), s in sizes.items() if c == channel and s > 0] or [1.0]))
        for channel in {c for _, c in sizes} - set(EVENT_CHANNELS)
    }
    return {channel: size for channel, size in sorted(usual.items()) if size < QUIET}


def residual_sizes(bench: Workbench, fit: Fit) -> dict[tuple[int, str], float]:
    """Recording and channel -> root-mean-square residual in noise levels."""
    sizes = loss.group_sizes(fit.residual, bench.data.groups, bench.weight * reversal_weights(bench, fit))
    return {(g.recording, g.channel): float(s) for g, s in zip(bench.data.groups, sizes, strict=True)}


def _leftovers(state: SearchState) -> dict[str, Leftover]:
    """Channel -> what is left of it, as the rules of explanation read it; channels of single instants left out."""
    before = residual_sizes(state.start.bench, state.base)
    after, samples = residual_sizes(state.bench, state.best), _independent_samples(state.bench)
    found = {}
    for channel, recordings in _recordings(state.bench).items():
        keys = [(i, channel) for i in recordings]
        # A right effect leaves a part of what it explains, by the chain's discretisation.
        sizes = [
            float(np.sqrt(max(after[k] ** 2 - (LEFT_SHARE * before.get(k, 0.0)) ** 2, 0.0))) for k in keys
        ]
        # The root-mean-square of n normal deviates scatters by 1/sqrt(2 n).
        deviations = [1 / float(np.sqrt(2 * max(samples[k], 1.0))) for k in keys]
        left = Leftover(sizes, deviations, len(state.bench.prepared))
        found[channel] = _with_function(state, left) if channel == HUB else left
    return found


def _with_function(state: SearchState, left: Leftover) -> Leftover:
    """The leftover of the hub with the evidence of the likeliest smooth function, if any was asked for."""
    if not state.unnamed:
        return left
    best = state.unnamed[0]
    return Leftover(left.sizes, left.deviations, left.recordings, best.evidence, best.by_chance, state.gained)


def _recordings(bench: Workbench) -> dict[str, list[int]]:
    """Channel -> recordings in which it is compared; channels of single instants left out."""
    found: dict[str, list[int]] = {}
    for group in bench.data.groups:
        if group.channel not in EVENT_CHANNELS:
            found.setdefault(group.channel, []).append(group.recording)
    return found


def _independent_samples(bench: Workbench) -> dict[tuple[int, str], float]:
    """Recording and channel -> number of independent samples."""
    found = {(g.recording, g.channel): 0.0 for g in bench.data.groups}
    for group, count in zip(bench.groups, bench.count, strict=True):
        found[group.recording, group.channel] += float(count)
    return found
