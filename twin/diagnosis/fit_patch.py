"""Unexplained residuals as a lookup over one variable, and its effect on held-out recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin import labels
from twin.campaigns.campaign import Campaign
from twin.diagnosis import dependence, remainder, rules
from twin.diagnosis.answer import Patched, Prediction
from twin.diagnosis.dependence import Unexplained
from twin.diagnosis.error_budget import rms_error
from twin.diagnosis.state import SearchState, UnnamedFunction
from twin.estimation import first_state
from twin.estimation.calibrate import noise_levels, prepare_clean
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.static_friction import FinalModels
from twin.mechanics.state import Start
from twin.recording import CHANNEL_UNITS, HUB_TORQUE
from twin.residuals.prepared import Prepared
from twin.residuals.residual import has_unknown_zero
from twin.rigs import patch
from twin.rigs.model import with_fine_chain
from twin.rigs.patch import Patch
from twin.rigs.simulate import simulate

WORSE = (
    "There is no lookup, because the one that was fitted predicts the held-out recordings worse than none."
)


def fit_patch(
    campaign: Campaign,
    state: SearchState,
    residuals: Mapping[str, Unexplained],
    polished: FinalModels,
    predictions: Mapping[str, Prediction],
    pool: ResidualPool,
) -> Patched | None:
    """Fits the residuals of the worst channel as a function of the variable on which they depend most.

    Args:
      campaign: the recordings.
      state: the end of the search.
      residuals: channel -> residuals of the final model.
      polished: the final model, to which the lookup is added.
      predictions: file -> recording and simulations, with the errors without the lookup.
      pool: where the simulations run.

    Returns:
      The lookup with its held-out errors; None if the residuals are no function of one variable that a simulation can
      evaluate.
    """
    lookup = patch_of_worst_channel(state, residuals)
    if lookup is None:
        return None
    model = with_fine_chain(polished.augmented.model.replace(patch=lookup))
    noise = noise_levels(campaign)

    def errors(prepared: Prepared, start: Start) -> dict[str, tuple[float, float]]:
        after = simulate(model, prepared.recording, start)
        before = predictions[prepared.recording.name].errors
        off = {c: prepared.recording[c] - after[c] for c in prepared.channels}
        return {
            c: (before[c].after, rms_error(off[c], has_unknown_zero(model, prepared, c)))
            for c in prepared.channels
        }

    ready = [prepare_clean(r, campaign.sensors, state.start.clock, noise)[0] for r in campaign.holdout()]
    starts = first_state.first_states(model, ready, pool)
    unit = CHANNEL_UNITS["motor_torque"] if lookup.channel == HUB_TORQUE else CHANNEL_UNITS[lookup.channel]
    gains = dict(zip((p.recording.name for p in ready), pool.map(errors, ready, starts), strict=True))
    return Patched(lookup, unit, gains)


def patch_of_worst_channel(state: SearchState, residuals: Mapping[str, Unexplained]) -> Patch | None:
    """The lookup of the worst channel whose residuals are a function of one variable, or of the smooth hub torque."""
    for channel in remainder.large_residuals(state):
        if channel not in residuals:
            continue
        unexplained = residuals[channel]
        for variable, share in sorted(dependence.step_shares(unexplained).items(), key=lambda pair: -pair[1]):
            if share < rules.MODEL_SHARE:
                break
            values = unexplained.variables[variable]
            lookup = patch.fit_lookup(unexplained.values, values, unexplained.recording, channel, variable)
            if lookup is not None and lookup.is_simulable:
                return lookup
    smooth = remainder.significant_function(state)
    return None if smooth is None else smooth.lookup


def why_no_patch(
    residuals: Mapping[str, Unexplained], depends: Sequence[str], smooth: UnnamedFunction | None = None
) -> str:
    """Why there is no lookup, in one sentence.

    Args:
      residuals: channel -> its residuals, of channels that are not explained.
      depends: variables on which they depend, the strongest first.
      smooth: the smooth torque on the hub behind them, if it is significant.
    """
    if not depends:
        return "There is no lookup, because the residuals depend on none of the variables that were tested."
    first = depends[0]
    if first == dependence.TRAVEL:
        return (
            "There is no lookup, because the residuals depend on how far the hub has turned since its last reversal: "
            "a simulation evaluates no such function."
        )
    if smooth is not None and smooth.law.sided and first in smooth.law.variables:
        name = labels.variable(smooth.law.variable).label
        return (
            f"There is no lookup, because the residuals depend on the {name} and change their sign with the direction "
            "of the hub: a simulation evaluates no such function."
        )
    explained = [
        channel
        for channel, unexplained in residuals.items()
        if dependence.step_shares(unexplained).get(first, 0.0) >= rules.MODEL_SHARE
    ]
    if not explained and first == "time":
        return "There is no lookup, because the residuals differ at the same instant of different recordings."
    if not explained:
        return "There is no lookup, because no single variable explains the residuals of every recording."
    name = labels.variable(first).label
    if not any(Patch(channel, first, *np.zeros((3, 0))).is_simulable for channel in explained):
        return (
            f"There is no lookup, because the residuals depend on the {name}: "
            "a simulation evaluates no such function."
        )
    return f"There is no lookup, because too little of the range of the {name} was seen in more than one recording."
