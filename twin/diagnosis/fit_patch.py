"""What is outside the library as a lookup, and what that gains on held-out recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from twin import labels
from twin.campaigns.campaign import Campaign
from twin.diagnosis import dependence, remainder
from twin.diagnosis.answer import Patched, Prediction
from twin.diagnosis.dependence import Unexplained
from twin.diagnosis.state import SearchState, UnnamedFunction
from twin.estimation import first_state
from twin.estimation.calibrate import noise_levels, prepare_clean
from twin.estimation.static_friction import FinalModels
from twin.mechanics.state import Start
from twin.recording import CHANNEL_UNITS, HUB
from twin.residuals.prepared import Prepared
from twin.rigs import patch
from twin.rigs.model import fine
from twin.rigs.patch import Patch
from twin.rigs.simulate import simulate

_LEAST_SHARE = 0.05  # of the variance that a variable must explain across recordings


def fit_patch(
    campaign: Campaign,
    found: SearchState,
    left: Mapping[str, Unexplained],
    polished: FinalModels,
    predictions: Mapping[str, Prediction],
    pool: ThreadPoolExecutor,
) -> Patched | None:
    """Fits the worst unexplained channel as a function of the variable it depends on most.

    Returns:
      The lookup with its held-out errors; None where what is left is no function of one variable that a simulation
      knows.
    """
    lookup = patch_of_worst_channel(found, left)
    if lookup is None:
        return None
    model = fine(polished.augmented.model.replace(patch=lookup))
    noise = noise_levels(campaign)

    def errors(prepared: Prepared, start: Start) -> dict[str, tuple[float, float]]:
        after = simulate(model, prepared.recording, start)
        before = predictions[prepared.recording.name].errors
        return {c: (before[c].after, _rms(prepared.recording[c] - after[c])) for c in prepared.channels}

    ready = [prepare_clean(r, campaign.sensors, found.start.clock, noise)[0] for r in campaign.holdout()]
    starts = [first_state.first_state(model, prepared, pool) for prepared in ready]
    unit = CHANNEL_UNITS["motor_torque"] if lookup.channel == HUB else CHANNEL_UNITS[lookup.channel]
    gains = dict(zip((p.recording.name for p in ready), pool.map(errors, ready, starts), strict=True))
    return Patched(lookup, unit, gains)


def patch_of_worst_channel(found: SearchState, left: Mapping[str, Unexplained]) -> Patch | None:
    """The lookup of the first unexplained channel that is a function of one variable."""
    for channel in remainder.large_residuals(found):
        odd = left[channel]
        for variable, share in sorted(dependence.step_shares(odd).items(), key=lambda pair: -pair[1]):
            if share < _LEAST_SHARE:
                break
            lookup = patch.smooth(odd.values, odd.variables[variable], odd.recording, channel, variable)
            if lookup is not None and lookup.acts:
                return lookup
    smooth = remainder.significant_function(found)
    return None if smooth is None else smooth.lookup


def why_no_patch(
    left: Mapping[str, Unexplained], depends: Sequence[str], smooth: UnnamedFunction | None = None
) -> str:
    """Why there is no lookup, in one sentence.

    Args:
      left: channel -> what is left of it, of those that are not explained.
      depends: variables on which that depends, the first most.
      smooth: the torque on the hub that is behind it, if there is one.
    """
    if not depends:
        return "There is no lookup, because what is left depends on none of the variables that were asked."
    first = depends[0]
    if first == dependence.TRAVEL:
        return (
            "There is no lookup, because what is left depends on how far the hub has turned since it turned round: "
            "no function that a simulation knows."
        )
    if smooth is not None and smooth.law.sided and first in smooth.law.variables:
        name = labels.variable(smooth.law.variable).label
        return (
            f"There is no lookup, because what is left depends on the {name} and turns its sign with the direction of "
            "the hub: no function that a simulation knows."
        )
    told = [
        channel
        for channel, odd in left.items()
        if dependence.step_shares(odd).get(first, 0.0) >= _LEAST_SHARE
    ]
    if not told and first == "time":
        return "There is no lookup, because what is left is another at the same instant of another recording."
    if not told:
        return "There is no lookup, because no variable alone tells what is left in every recording."
    name = labels.variable(first).label
    if not any(Patch(channel, first, *np.zeros((3, 0))).acts for channel in told):
        return f"There is no lookup, because what is left depends on the {name}: no function that a simulation knows."
    return f"There is no lookup, because too little of the range of the {name} was seen in more than one recording."


def _rms(difference: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(difference**2)))
