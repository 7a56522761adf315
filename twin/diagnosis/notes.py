"""What the reader of a diagnosis should know beside its answer: what was assumed, what is odd, what is uncertain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.diagnosis import dependence, remainder, rules
from twin.diagnosis.answer import Prediction
from twin.diagnosis.dependence import Unexplained
from twin.diagnosis.state import SearchState
from twin.estimation.calibrate import late_command_notes
from twin.estimation.fit import Fit
from twin.estimation.static_friction import FinalModels
from twin.labels import named
from twin.parameters import ASSUMED_UNCERTAINTY
from twin.recording import HUB
from twin.residuals import static_levels
from twin.residuals.rest_run import RestRun
from twin.residuals.view import View

_MUCH = 0.2  # share of what is left that one parameter's change explains, from which it is told
_FAR = 30.0  # noise levels by which a prediction may change with a tiny change of the break-away torque
_STUCK = (
    0.15  # relative error of the static friction, three times what the instants of the break-aways leave open
)
_END = 1e-3  # of the end of a range within which a number stands at it
_BESIDE = 0.03  # s between two readings of the instant of one break-away
_ASTRAY = 10.0  # times what can be predicted that a held-out recording may be off


def all_notes(
    campaign: Campaign,
    found: SearchState,
    behind: Mapping[str, Unexplained],
    polished: FinalModels,
    predictions: Mapping[str, Prediction],
    depends: Sequence[str],
) -> tuple[str, ...]:
    """Sentences on a diagnosis, as by `conclude`; `depends` are variables on which what is left depends."""
    return (
        *campaign.warnings,
        *found.start.notes,
        *(note for p in predictions.values() if p.role == "holdout" for note in p.left_out),
        *late_command_notes(polished.augmented),
        *_assumptions(campaign),
        *_known(found),
        *_alone(found),
        *_quiet(found),
        *_nameless(found),
        *_instead(found),
        *drifting_parameter(behind, depends),
        *_taken_back(found),
        *at_range_end(polished.augmented, found.names),
        *break_aways(found),
        *_unpredictable(predictions),
        *missed_held_out(found, predictions),
    )


def drifting_parameter(behind: Mapping[str, Unexplained], depends: Sequence[str]) -> list[str]:
    """The parameter whose change with time is what a model leaves, if that says much of it."""
    if HUB not in behind or depends[:1] != ("time",):
        return []
    name, share = dependence.parameter_drift(behind[HUB])
    if share < _MUCH:
        return []
    return [
        f"{100 * share:.0f} % of what is left of the torque on the hub are as if {name} changed while a recording goes "
        "on, in each in the same way: something that warms up, wears in or comes loose."
    ]


def _assumptions(campaign: Campaign) -> list[str]:
    unsaid = [
        n for n, p in campaign.rig.parameters.items() if p.uncertainty is None and n in ASSUMED_UNCERTAINTY
    ]
    moved = [n for n in unsaid if campaign.rig[n] != 0]
    if not moved:
        return []
    listed = ", ".join(f"{n} {100 * ASSUMED_UNCERTAINTY[n]:g} %" for n in moved)
    return [f"No uncertainty was declared for some parameters; assumed: {listed}."]


def _known(found: SearchState) -> list[str]:
    if not found.known:
        return []
    return [
        f"The rig was declared with {' and '.join(found.known)}, fitted anew: what is missing is missing beside."
    ]


def _alone(found: SearchState) -> list[str]:
    """What one recording says against the model, and no other."""
    files = [prepared.recording.name for prepared in found.bench.prepared]
    return [
        f"{files[i]} alone leaves {size:.2g} noise levels of {named(channel)} unexplained, no other recording "
        "does: a fault that only this experiment provokes, or a bad recording. Repeat it."
        for i, channel, size in remainder.in_one_recording(found)
    ]


def _quiet(found: SearchState) -> list[str]:
    """Channels whose declared noise hides what is smaller."""
    told = {("hub_angle" if c == HUB else c): size for c, size in remainder.overstated_noise(found).items()}
    return [
        f"{named(channel).capitalize()} scatters {1 / size:.2g} times less than its declared noise: what is smaller "
        "than that was not looked for. Declare the noise that the sensor has, or none: it is estimated then."
        for channel, size in told.items()
    ]


def _nameless(found: SearchState) -> list[str]:
    """How sure a function is that no effect explains."""
    smooth = remainder.significant_function(found)
    if smooth is None:
        return []
    sided = " that turns its sign with the direction of the hub" if smooth.law.sided else ""
    read = ", which the sensor of the drive's torque reads too," if smooth.law.drive else ""
    return [
        f"A torque on the hub{read} that is a smooth function of {named(smooth.law.variable)}{sided} makes the "
        f"recordings e^{smooth.evidence:.0f} times likelier; chance, as seldom as the false-alarm rate asks for, "
        f"e^{max(smooth.by_chance, 0):.0f} times."
    ]


def _instead(found: SearchState) -> list[str]:
    """Why an effect was adopted that is small by its score."""
    if found.instead is None:
        return []
    return [
        f"{found.names[-1]} gains {found.adopted[-1].score:.0f}, less than {rules.MODEL_ERROR_SCORE:g}. But something "
        f"is missing for sure: a smooth torque on the hub over {named(found.instead.law.variable)} makes the "
        f"recordings e^{found.instead.evidence:.0f} times likelier, and the effect explains as much with the numbers "
        "it takes."
    ]


def _taken_back(found: SearchState) -> list[str]:
    untold = [name for name, judgement in found.withdrawn if judgement.rule == "size-is-told"]
    if not untold:
        return []
    *first, last = untold
    return [
        f"{', '.join(first)} and {last} together follow what was measured, but how large either is cannot be told: "
        "each takes away what the other adds. They stand for something else and are not taken for its cause."
    ]


def at_range_end(best: Fit, names: Sequence[str]) -> list[str]:
    """Effects of which a number would go on beyond what it may be, were it let: these stand for something else."""
    told: dict[str, list[str]] = {}
    for u, value in zip(best.unknowns, best.values, strict=True):
        # A level of friction may be none at all.
        ends = [end for end in u.bounds if end != 0 and abs(value - end) <= _END * abs(end)]
        if u.effect in names and ends:
            told.setdefault(u.effect, []).append(f"{u.name} {u.turned(value):.3g}")
    return [
        f"{name} came to the end of its range ({', '.join(numbers)}): it follows what was measured, but it may stand "
        "for something else."
        for name, numbers in told.items()
    ]


def break_aways(found: SearchState) -> list[str]:
    """Directions in which the hub breaks away at another torque than the model's: all else may be explained yet."""
    best = found.best
    # Out of a long rest, under a torque that grows slowly: elsewhere the hub may only have been slow.
    runs = [
        run
        for i, run in static_levels.rest_runs(found.data, best.model, best.starts)
        if run.is_slow and _at_onset(found.data.views[i], run)
    ]
    told = []
    for direction, where in ((1, "forwards"), (-1, "backwards")):
        torques = np.array([run.holding_torque[0] for run in runs if run.direction == direction])
        levels = np.array([run.level for run in runs if run.direction == direction])
        if len(torques) and abs(np.median(torques / levels) - 1) > _STUCK:
            told.append(f"at {np.median(torques):.2g} N m {where} (the model: {np.median(levels):.2g} N m)")
    if not told:
        return []
    return [
        f"The hub breaks away {' and '.join(told)}. So few instants decide nothing: record slow ramps of torque, both "
        "ways."
    ]


def _at_onset(view: View, run: RestRun) -> bool:
    return any(abs(view.time[k] - run.end_of_rest) < _BESIDE for k, _ in view.onsets)


def _unpredictable(predictions: Mapping[str, Prediction]) -> list[str]:
    """Held-out recordings whose error says little: a stick or slip more decides them."""
    notes = []
    for file, prediction in predictions.items():
        worst = max(prediction.errors.values(), key=lambda e: e.reach / e.noise, default=None)
        if prediction.role == "holdout" and worst is not None and worst.reach > _FAR * worst.noise:
            notes.append(
                f"{file} can hardly be predicted: a break-away torque that is off by 0.1 % changes the prediction by "
                f"{worst.reach / worst.noise:.0f} noise levels, because one stick more or less decides the rest of it."
            )
    return notes


def missed_held_out(found: SearchState, predictions: Mapping[str, Prediction]) -> list[str]:
    """Held-out recordings that the model misses, though it follows those that it was fitted to."""
    if remainder.unexplained_channels(found):
        return []
    notes = []
    for file, prediction in predictions.items():
        if prediction.role != "holdout":
            continue
        sizes = {c: e.after / max(e.noise, e.reach) for c, e in prediction.errors.items() if e.noise > 0}
        worst = max(sizes, key=lambda c: sizes[c], default=None)
        if worst is not None and sizes[worst] > _ASTRAY:
            levels = prediction.errors[worst].after / prediction.errors[worst].noise
            notes.append(
                f"{file} was held out, and {named(worst)} is missed by {levels:.0f} noise levels, though those that "
                "were fitted are followed: it shows what they do not, or the explanation is not the right one."
            )
    return notes
