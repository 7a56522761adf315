"""Residuals of the final model, judged by `rules.EXPLANATION`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.diagnosis.judgement import Judgement, judge_all
from twin.diagnosis.rules import (
    EXPLANATION,
    MODEL_ERROR_SCORE,
    MODEL_SHARE,
    Leftover,
    decisive_difference,
    excesses,
)
from twin.diagnosis.state import SearchState, UnnamedFunction
from twin.estimation import loss
from twin.estimation.fit import Fit
from twin.estimation.loss import ADEQUATE_RMS
from twin.estimation.workbench import Workbench, reversal_weights
from twin.recording import HUB_TORQUE
from twin.residuals.residual import EVENT_CHANNELS
from twin.residuals.significance import SIGNIFICANT

QUIET = 1 / 3
"""Residual size [noise levels] below which the declared noise of a channel is too large."""


def judge_channels(state: SearchState) -> dict[str, tuple[Judgement, ...]]:
    """Channel -> judgement of its residuals by each rule of explanation."""
    return {channel: judge_all(EXPLANATION, left) for channel, left in _leftovers(state).items()}


def unexplained_channels(state: SearchState) -> tuple[str, ...]:
    """Channels that are not explained: those with `large_residuals`, and the hub with a `significant_function`."""
    large = large_residuals(state)
    return large if HUB_TORQUE in large or significant_function(state) is None else (*large, HUB_TORQUE)


def significant_function(state: SearchState) -> UnnamedFunction | None:
    """The smooth function with the largest evidence, if it is significant."""
    if not state.unnamed:
        return None
    *_, function = judge_all(EXPLANATION, _with_function(state, Leftover((), (), 0)))
    return None if function.passed else state.unnamed[0]


def likeliest_functions(
    state: SearchState, on_link: Sequence[UnnamedFunction]
) -> tuple[UnnamedFunction, ...]:
    """The function with the largest evidence that describes what is unexplained; on the link, also those as good as it.

    Args:
      state: the end of the search.
      on_link: functions that were tried on the link, the largest evidence first, see `link_functions`.

    Returns:
      The functions, the best one first; empty if none describes it.
    """
    on_hub = significant_function(state)
    # On the link, the error of the chain gives a function some evidence.
    best = next((f for f in on_link[:1] if f.evidence > max(f.by_chance, MODEL_ERROR_SCORE)), None)
    if best is None or (on_hub is not None and on_hub.evidence >= best.evidence):
        return () if on_hub is None else (on_hub,)
    least = best.evidence - decisive_difference(best.evidence)
    return tuple(f for f in on_link if f.evidence >= least)


def large_residuals(state: SearchState) -> tuple[str, ...]:
    """Channels whose residuals exceed noise in several recordings, the largest first."""
    medians: dict[str, float] = {}
    for channel, left in _leftovers(state).items():
        worst, repeated, _ = judge_all(EXPLANATION, left)
        if not worst.passed and not repeated.passed:
            sizes = np.asarray(left.sizes)
            medians[channel] = float(np.median(sizes[excesses(left, ADEQUATE_RMS, SIGNIFICANT) > 1]))
    return tuple(sorted(medians, key=lambda c: -medians[c]))


def in_one_recording(state: SearchState) -> list[tuple[int, str, float]]:
    """Recording, channel and size of each large residual that no other recording shows in that channel."""
    repeated, single = large_residuals(state), []
    by_place = {_place(c): r for c, r in _recordings(state.bench).items()}
    for channel, left in _leftovers(state).items():
        worst, *_ = judge_all(EXPLANATION, left)
        if channel in repeated or worst.passed:
            continue
        for k in np.flatnonzero(excesses(left, ADEQUATE_RMS, SIGNIFICANT) > 1).tolist():
            single.append((by_place[channel][k], channel, float(left.sizes[k])))
    return single


def overstated_noise(state: SearchState) -> dict[str, float]:
    """Channel -> median size of its residuals [noise levels], of channels much quieter than declared."""
    sizes = residual_sizes(state.bench, state.best)
    medians = {
        channel: float(np.median([s for (_, c), s in sizes.items() if c == channel and s > 0] or [1.0]))
        for channel in {c for _, c in sizes} - set(EVENT_CHANNELS)
    }
    return {channel: size for channel, size in sorted(medians.items()) if size < QUIET}


def residual_sizes(bench: Workbench, fit: Fit) -> dict[tuple[int, str], float]:
    """Recording and channel -> root-mean-square residual [noise levels]."""
    sizes = loss.group_sizes(fit.residual, bench.data.groups, bench.weight * reversal_weights(bench, fit))
    return {(g.recording, g.channel): float(s) for g, s in zip(bench.data.groups, sizes, strict=True)}


def _leftovers(state: SearchState) -> dict[str, Leftover]:
    """Channel -> its residuals as a trial of `rules.EXPLANATION`; channels of single instants are left out."""
    before = residual_sizes(state.start.bench, state.base)
    after, samples = residual_sizes(state.bench, state.best), _independent_samples(state.bench)
    leftovers = {}
    for channel, recordings in _recordings(state.bench).items():
        keys = [(i, channel) for i in recordings]
        # Discretisation leaves a share of the residual that a right effect explains, if the hub is not free.
        share = 0.0 if state.on_output_errors else MODEL_SHARE
        sizes = [float(np.sqrt(max(after[k] ** 2 - (share * before.get(k, 0.0)) ** 2, 0.0))) for k in keys]
        # Standard deviation of the root-mean-square of n standard normal samples: 1/sqrt(2 n).
        deviations = [1 / float(np.sqrt(2 * max(samples[k], 1.0))) for k in keys]
        left = Leftover(sizes, deviations, len(state.bench.prepared))
        place = _place(channel)
        leftovers[place] = _with_function(state, left) if place == HUB_TORQUE else left
    return leftovers


def _place(channel: str) -> str:
    """Name under which residuals are judged: the error of a free-running hub is that of the torques on it."""
    return HUB_TORQUE if channel == "hub_angle" else channel


def _with_function(state: SearchState, left: Leftover) -> Leftover:
    """The leftover of the hub with the largest evidence of a smooth function, if any was tested."""
    if not state.unnamed:
        return left
    best = state.unnamed[0]
    return Leftover(left.sizes, left.deviations, left.recordings, best.evidence, best.by_chance, state.gained)


def _recordings(bench: Workbench) -> dict[str, list[int]]:
    """Channel -> recordings that have it; channels of single instants are left out."""
    recordings: dict[str, list[int]] = {}
    for group in bench.data.groups:
        if group.channel not in EVENT_CHANNELS:
            recordings.setdefault(group.channel, []).append(group.recording)
    return recordings


def _independent_samples(bench: Workbench) -> dict[tuple[int, str], float]:
    """Recording and channel -> number of independent samples."""
    samples = {(g.recording, g.channel): 0.0 for g in bench.data.groups}
    for group, count in zip(bench.groups, bench.count, strict=True):
        samples[group.recording, group.channel] += float(count)
    return samples
