"""Notes of an answer: assumptions, inconsistencies of the data, and limits of the result, as sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.diagnosis import dependence, remainder, revise
from twin.diagnosis.answer import Prediction
from twin.diagnosis.dependence import Unexplained
from twin.diagnosis.state import DRIVE, SearchState, UnnamedFunction
from twin.estimation.calibrate import late_command_notes
from twin.estimation.fit import Fit
from twin.estimation.static_friction import FinalModels
from twin.estimation.unknowns import Unknown
from twin.labels import acting, sentence, with_error, with_the
from twin.parameters import ASSUMED_UNCERTAINTY
from twin.recording import HUB_TORQUE
from twin.residuals import static_levels
from twin.residuals.rest_run import RestRun
from twin.residuals.significance import SIGNIFICANT
from twin.residuals.view import View

_SMALL = 0.1  # share of its declared deviation up to which a gain or a delay of a channel is not noted
_DRIFT_SHARE = 0.2  # share of the variance of the residuals from which a drifting parameter is noted
_UNPREDICTABLE = 30.0
"""Sensitivity `ChannelError.unknown` [noise levels] from which a held-out recording is called unpredictable."""
_BREAK_AWAY_ERROR = 0.15
"""Relative error of the static friction that is noted: three times the uncertainty of a single break-away."""
_SAME_BREAK_AWAY = 0.03  # s, largest difference of two estimates of the instant of one break-away
_MISSED = 10.0
"""Prediction error of a held-out recording, over the larger of noise and sensitivity, from which it is noted."""


def all_notes(
    campaign: Campaign,
    state: SearchState,
    residuals: Mapping[str, Unexplained],
    polished: FinalModels,
    predictions: Mapping[str, Prediction],
    depends: Sequence[str],
    functions: Sequence[UnnamedFunction] = (),
) -> tuple[str, ...]:
    """All notes; arguments as `conclude`, with what unexplained residuals depend on, and functions behind them."""
    return (
        *campaign.warnings,
        *state.start.notes,
        *(note for p in predictions.values() if p.role == "holdout" for note in p.left_out),
        *late_command_notes(polished.augmented),
        *channel_error_notes(polished.augmented),
        *_assumptions(campaign),
        *_known_effects(state),
        *drive_notes(campaign, polished.augmented),
        *back_emf(campaign, polished.augmented.model.effects if state.adopted else {}),
        *_single_recordings(state),
        *_overstated_noise(state),
        *map(_unnamed_function, functions),
        *drifting_parameter(residuals, depends),
        *_undetermined_sizes(state),
        *at_range_end(polished.augmented, state.names),
        *break_away_notes(state),
        *_unpredictable(predictions),
        *missed_held_out(state, predictions),
    )


def channel_error_notes(fit: Fit) -> list[str]:
    """A note on each fitted gain or delay of a channel that differs significantly from its declaration."""
    notes = []
    for u, value, error in zip(fit.unknowns, fit.values, fit.errors, strict=True):
        if not u.is_channel_error or abs(value - u.start) <= max(SIGNIFICANT * error, _SMALL * u.scale):
            continue
        fitted = f"The {u.kind} of {with_the(u.name)} is taken as {_in_its_unit(u, value, error)}"
        note = f"{fitted}, within its declaration, {_in_its_unit(u, u.start, u.scale)}."
        if revise.is_at_end(u, value):
            note = (
                f"{fitted}, the end of what its declaration allows, {_in_its_unit(u, u.start, u.scale)}: the "
                "recordings contradict this declaration."
            )
        notes.append(note)
    return notes


def _in_its_unit(u: Unknown, value: float, error: float) -> str:
    """A gain, or a delay in milliseconds, with its standard deviation."""
    return with_error(value, error) if u.kind == "gain" else f"{with_error(1e3 * value, 1e3 * error)} ms"


def drifting_parameter(residuals: Mapping[str, Unexplained], depends: Sequence[str]) -> list[str]:
    """Note on the parameter whose drift explains the torque balance of the hub, if residuals depend on time."""
    if HUB_TORQUE not in residuals or depends[:1] != ("time",):
        return []
    name, share = dependence.parameter_drift(residuals[HUB_TORQUE])
    if share < _DRIFT_SHARE:
        return []
    return [
        f"{100 * share:.0f} % of the variance of the unexplained torque on the hub are as if {name} changed during "
        "each recording in the same way: something that warms up, wears in or comes loose."
    ]


def _assumptions(campaign: Campaign) -> list[str]:
    undeclared = [
        n for n, p in campaign.rig.parameters.items() if p.uncertainty is None and n in ASSUMED_UNCERTAINTY
    ]
    moved = [n for n in undeclared if campaign.rig[n] != 0]
    if not moved:
        return []
    listed = ", ".join(f"{n} {100 * ASSUMED_UNCERTAINTY[n]:g} %" for n in moved)
    return [f"No uncertainty was declared for some parameters; assumed: {listed}."]


def _known_effects(state: SearchState) -> list[str]:
    if not state.known:
        return []
    return [
        f"The rig was declared with {' and '.join(state.known)}, fitted again: effects named as missing are additional."
    ]


def verdict_caveats(campaign: Campaign, fit: Fit, adopted: bool) -> tuple[str, ...]:
    """What has to be settled before the verdict is used; in full in `all_notes`.

    Args:
      campaign: the recordings.
      fit: of the final model.
      adopted: whether it has an effect that the model lacked.
    """
    caveats = []
    if adopted and back_emf(campaign, fit.model.effects):
        caveats.append(
            "The viscous friction may be the back-EMF of a drive that is not declared: declare it in [drive]."
        )
    if scale := unsure_scale(campaign):
        caveats.append(f"All values hold only if {scale} is right.")
    return tuple(caveats)


def unsure_scale(campaign: Campaign) -> str:
    """Torque per volt or ampere that was taken as certain and of no declared drive; "" without any."""
    command = campaign.sensors.get("torque_command")
    if campaign.raw_command is None or (command is not None and command.gain_uncertainty):
        return ""
    torque, unit, is_of_drive = campaign.raw_command
    return "" if is_of_drive else f"{torque:.3g} N·m/{unit}"


def drive_notes(campaign: Campaign, fit: Fit) -> list[str]:
    """What was fitted of a drive of which the torque per volt or ampere was declared, in terms of its command."""
    if campaign.raw_command is None:
        return []
    torque, unit, is_of_drive = campaign.raw_command
    effects, declared = fit.model.effects, campaign.effects
    gain = effects.get("torque-gain", {}).get("gain", 1.0)
    notes = []
    if is_of_drive:
        said = f"[drive] declares {torque:.3g} N·m/{unit} at the hub; fitted: {gain * torque:.3g} N·m/{unit}."
        if "viscous-friction" in declared:
            before, after = (of["viscous-friction"]["viscous"] for of in (declared, effects))
            said += (
                f" Its back-EMF declares {before:.3g} N·m·s/rad of friction; fitted: {after:.3g} N·m·s/rad."
            )
        scaled = "The scale of torques, inertias and stiffnesses is known as well as these, ratios are known better."
        notes.append(f"{said} {scaled}")
    elif scale := unsure_scale(campaign):
        notes.append(
            f"Parameters and standard errors hold if {scale} is right: inertias, stiffnesses and "
            "frictions are proportional to it. Declare gain_uncertainty, or the motor in [drive], if it is not sure."
        )
    if width := effects.get("dead-zone", {}).get("half_width", 0.0):
        notes.append(
            f"The dead zone of {width:.3g} N·m is {width / (gain * torque):.3g} {unit} of the command."
        )
    return notes


def back_emf(campaign: Campaign, effects: Mapping[str, Mapping[str, float]]) -> list[str]:
    """A note where viscous friction was found under a voltage of which no drive is declared: it looks like back-EMF.

    A DC motor under a voltage gives gain (V - k omega), which is a torque less a friction of gain k at the hub.
    """
    viscous, gain = effects.get("viscous-friction", {}).get("viscous", 0.0), campaign.torque_per_volt
    if gain is None or not viscous > 0:
        return []
    return [
        f"The command is a voltage, and the viscous friction of {viscous:.3g} N·m·s/rad looks like the back-EMF of its "
        f"drive: {viscous / abs(gain):.3g} V·s/rad at the hub (gear ratio times back-EMF constant). Compare it with "
        'the data sheet of the motor, and declare the drive in [drive] with kind = "voltage".'
    ]


def _single_recordings(state: SearchState) -> list[str]:
    """Notes on residuals of one channel that a single recording shows."""
    files = [prepared.recording.name for prepared in state.bench.prepared]
    return [
        f"{files[i]} alone leaves {size:.2g} noise levels of {with_the(channel)} unexplained, no other recording "
        "does: a fault that only this experiment provokes, or a bad recording. Recorded again, a fault shows again."
        for i, channel, size in remainder.in_one_recording(state)
    ]


def _overstated_noise(state: SearchState) -> list[str]:
    """Notes on channels whose declared noise is too large."""
    sizes = {
        ("hub_angle" if c == HUB_TORQUE else c): size for c, size in remainder.overstated_noise(state).items()
    }
    return [
        f"{sentence(with_the(channel))} scatters {1 / size:.2g} times less than its declared noise: smaller effects "
        "were not sought. Declare the noise that the sensor has, or none: it is estimated then."
        for channel, size in sizes.items()
    ]


def _unnamed_function(function: UnnamedFunction) -> str:
    """Note on the evidence of a smooth function that no effect explains."""
    law = function.law
    sided = " that changes its sign with the direction of the hub" if law.sided else ""
    read = ", which the sensor of the drive's torque reads too," if law.place == DRIVE else ""
    return (
        f"{sentence(acting(law.place))}{read} that is a smooth function of {with_the(law.variable)}{sided} makes the "
        f"recordings e^{function.evidence:.0f} times likelier; by chance, at the false-alarm rate, it would be "
        f"e^{max(function.by_chance, 0):.0f} times."
    )


def _undetermined_sizes(state: SearchState) -> list[str]:
    """Note on effects that were withdrawn because their size is not determined."""
    if not state.undetermined:
        return []
    *first, last = state.undetermined
    if not first:
        return [
            f"{last} fits the recordings, but its size is not determined by them, or at the end of its range: it may "
            "imitate another fault and is not taken for its cause."
        ]
    return [
        f"{', '.join(first)} and {last} fit the recordings, but their sizes are not determined by them: they may "
        "imitate another fault, together or in turn, and are not taken for its cause."
    ]


def at_range_end(best: Fit, names: Sequence[str]) -> list[str]:
    """Notes on effects with a parameter at its bound, which may imitate another fault."""
    at_bound: dict[str, list[str]] = {}
    for u, value in zip(best.unknowns, best.values, strict=True):
        if u.effect in names and revise.is_at_end(u, value):
            at_bound.setdefault(u.effect, []).append(f"{u.name} {u.turned(value):.3g}")
    return [
        f"{name} came to the end of its range ({', '.join(numbers)}): it fits the recordings, but it may imitate "
        "another fault."
        for name, numbers in at_bound.items()
    ]


def break_away_notes(state: SearchState) -> list[str]:
    """Note on directions in which the hub breaks away at another torque than that of the model.

    The verdict does not depend on it: break-aways are single instants among thousands of samples.
    """
    best = state.best
    # Only after a long rest under a slowly growing torque: otherwise the instant of the break-away is uncertain.
    runs = [
        run
        for i, run in static_levels.rest_runs(state.data, best.model, best.starts)
        if run.is_slow and _at_onset(state.data.views[i], run)
    ]
    differing = []
    for direction, where in ((1, "forwards"), (-1, "backwards")):
        torques = np.array([run.holding_torque[0] for run in runs if run.direction == direction])
        levels = np.array([run.level for run in runs if run.direction == direction])
        if len(torques) and abs(np.median(torques / levels) - 1) > _BREAK_AWAY_ERROR:
            differing.append(
                f"at {np.median(torques):.2g} N·m {where} (the model: {np.median(levels):.2g} N·m)"
            )
    if not differing:
        return []
    return [
        f"The hub breaks away {' and '.join(differing)}. So few instants do not decide a verdict: record slow ramps of "
        "torque, both ways."
    ]


def _at_onset(view: View, run: RestRun) -> bool:
    """Whether the view, too, shows a break-away at the end of this rest."""
    return any(abs(view.time[k] - run.end_of_rest) < _SAME_BREAK_AWAY for k, _ in view.onsets)


def _unpredictable(predictions: Mapping[str, Prediction]) -> list[str]:
    """Notes on held-out recordings that cannot be predicted: a stick, or commands in missing rows, decide the rest."""
    notes = []
    for file, prediction in predictions.items():
        if prediction.role != "holdout":
            continue
        stick = max((e.reach / e.noise for e in prediction.errors.values()), default=0.0)
        gaps = max((e.by_gaps / e.noise for e in prediction.errors.values()), default=0.0)
        if gaps > _UNPREDICTABLE:
            notes.append(
                f"{file} can hardly be predicted: rows are missing, and commands with them; other commands there "
                f"change the prediction by {gaps:.0f} noise levels."
            )
        elif stick > _UNPREDICTABLE:
            notes.append(
                f"{file} can hardly be predicted: a break-away torque that is off by 0.1 % changes the prediction by "
                f"{stick:.0f} noise levels, because one stick more or less decides the rest of it."
            )
    return notes


def missed_held_out(state: SearchState, predictions: Mapping[str, Prediction]) -> list[str]:
    """Notes on held-out recordings that the model predicts badly though the fit recordings are explained."""
    if remainder.unexplained_channels(state):
        return []
    notes = []
    for file, prediction in predictions.items():
        if prediction.role != "holdout":
            continue
        sizes = {c: e.after / max(e.noise, e.unknown) for c, e in prediction.errors.items() if e.noise > 0}
        worst = max(sizes, key=lambda c: sizes[c], default=None)
        if worst is not None and sizes[worst] > _MISSED:
            levels = prediction.errors[worst].after / prediction.errors[worst].noise
            notes.append(
                f"{file} was held out, and {with_the(worst)} is missed by {levels:.0f} noise levels, though the fit "
                "recordings are explained: it shows a fault that they do not, or the explanation is wrong."
            )
    return notes
