"""Results of the procedures in sentences: estimates with intervals, their agreement, and which data are lacking.

The joint estimate has a module of its own, `joint_finding`.
"""

from __future__ import annotations

from collections.abc import Sequence

from scipy.constants import g

from twin import labels
from twin.identification.backbone import MIN_SWEEPS, Backbone
from twin.identification.balance import Balance
from twin.identification.bending_modes import SOFTENING_TOLERANCE
from twin.identification.break_away import StaticFriction
from twin.identification.compare_campaigns import Comparison, PairedPeak
from twin.identification.decay import Decay
from twin.identification.estimates import Estimate, Finding, Mode, normalised_difference
from twin.identification.friction_map import FrictionMap
from twin.identification.joint import JointEstimate, with_link_uncertainty
from twin.identification.spectra import Response
from twin.identification.static_test import LOADS, Outlier, StaticTest
from twin.identification.text import DISAGREEMENT, agreement, format_estimate
from twin.identification.total_inertia import MomentumBalance


def static(test: StaticTest | None, declared: Estimate) -> Finding:
    """Returns the finding of the static test; `declared` is the declared bending stiffness [N m^2]."""
    title = "Stiffness from a static test"
    if test is None:
        columns = " or ".join(LOADS)
        return Finding("static", title, (), f"no static.csv with tip_deflection beside {columns}")
    sentences = _gauge_curvature(test) if test.stiffness is None else _static_stiffness(test, declared)
    if test.outlier is not None:
        sentences += _outlier(test.outlier)
    p = test.line.curvature_probability
    if p == p:
        word = "straight" if test.line.is_straight else "curved"
        sentences.append(
            f"The line is {word}: the F test of a parabola against it has p = {labels.number(p, 2)}."
        )
    return Finding("static", title, tuple(sentences))


def _static_stiffness(test: StaticTest, declared: Estimate) -> list[str]:
    assert test.stiffness is not None
    line = test.line
    sentences = [
        f"{_stiffness(test)} by a line with a free intercept through {len(line.x)} loads, {_reading_errors(test)}."
    ]
    if abs(line.intercept.value) > 2 * line.intercept.standard_error:
        sentences.append(
            f"The intercept is that of a load of {_tare(test)} that was not recorded: a tare, or the zero of the ruler."
        )
    if declared.standard_error > 0:
        sentences.append(agreement(test.stiffness, declared, ("The static test", "the declared stiffness")))
    return sentences


def _gauge_curvature(test: StaticTest) -> list[str]:
    assert test.curvature is not None
    return [
        f"No load was recorded, so that no stiffness follows; one unit of {test.column} is a curvature of "
        f"{format_estimate(test.curvature, '1/m')} at the hub, with errors in proportion to the spread of both columns."
    ]


def _stiffness(test: StaticTest) -> str:
    """EI, and E where the second moment of area is given."""
    assert test.stiffness is not None
    text = f"EI = {format_estimate(test.stiffness, 'N*m^2')}"
    if test.modulus is None:
        return text
    return f"{text}, E = {format_estimate(test.modulus, 'Pa')} with the I that was given,"


def _reading_errors(test: StaticTest) -> str:
    x, y = test.errors
    if not (x > 0 and y > 0):
        return "the loads taken as exact"
    return f"load and displacement as uncertain as their last decimals, {x:.2g} N and {1e3 * y:.2g} mm"


def _tare(test: StaticTest) -> str:
    force = f"{test.tare:.3g} N"
    return f"{force} ({test.tare / g:.3g} kg)" if test.column == "tip_load_mass" else force


def _outlier(outlier: Outlier) -> list[str]:
    name, others = f"row {outlier.row + 1}", outlier.without
    away = labels.typeset(f"{1e3 * outlier.residual:+.3g}")
    sentences = [
        f"{name.capitalize()} lies {away} mm off the line through the others: a misreading, or a curved line."
    ]
    if others.stiffness is not None:
        sentences.append(f"Without it {_stiffness(others).removesuffix(',')}, tare = {_tare(others)}.")
    elif others.curvature is not None:
        sentences.append(f"Without it one unit is {format_estimate(others.curvature, '1/m')}.")
    if outlier.own_stiffness is not None:
        sentences.append(f"With that tare {name} by itself gives EI = {outlier.own_stiffness:.4g} N·m².")
    return sentences


def decays(ring_downs: Sequence[Decay]) -> Finding:
    """Returns the finding of the ring-downs of the clamped link."""
    title = "Damping from free vibration"
    if not ring_downs:
        missing = (
            "no clamped recording, and no rest of the hub, in which the link vibrates freely for four periods"
        )
        return Finding("decay", title, (), missing)
    return Finding("decay", title, tuple(s for d in ring_downs for s in _decay(d)))


def _decay(d: Decay) -> list[str]:
    where = f"{d.recording}, {labels.channel(d.channel).label}, {d.time[0]:.1f} to {d.time[-1]:.1f} s"
    sentences = [
        f"{where}: {format_estimate(d.frequency, 'Hz')}, damping ratio {format_estimate(d.damping_ratio)}.",
        agreement(d.by_decrement, d.by_fit, ("Logarithmic decrement", "fit of the decay")),
    ]
    if d.law == "proportional":
        sentences.append(
            "The envelope is exponential: the losses are proportional to the rate, without significant dry friction or "
            "air drag."
        )
    else:
        sentences.append(
            f"The envelope has a loss by {d.law}, {d.law_significance:.0f} standard errors from zero."
        )
    if abs(d.frequency_slope.value) > 4 * d.frequency_slope.standard_error:
        change = 100 * d.frequency_slope.value
        sentences.append(
            f"At its first amplitude the frequency is {labels.signed(change, 2)} % off that of small vibration."
        )
    return sentences


def break_aways(friction: StaticFriction) -> Finding:
    """Returns the finding of the static friction."""
    title = "Break-away friction from slow ramps"
    if friction.level is None:
        missing = "no recording in which a slowly growing torque ends a rest of the hub"
        return Finding("break-away", title, (), missing)
    count = f"{len(friction.events)} break-away{'s' if len(friction.events) > 1 else ''}"
    sentences = [f"{count}; static friction {format_estimate(friction.level, 'N*m')}."]
    for direction, level in friction.by_direction.items():
        side = "positive" if direction > 0 else "negative"
        sentences.append(f"Towards {side} angles {format_estimate(level, 'N*m')}.")
    if len(friction.by_direction) == 2:
        names = ("The level of the positive direction", "that of the negative one")
        sentences.append(agreement(friction.by_direction[1], friction.by_direction[-1], names))
    if friction.angle_spread == friction.angle_spread:
        spread = labels.number(friction.angle_spread, 2)
        sentences.append(f"Standard deviation over the angles at which they were read: {spread} N·m.")
    return Finding("break-away", title, tuple(sentences))


def coulomb(
    hub: Balance | None, release: FrictionMap | None, joint: JointEstimate, static_level: Estimate | None
) -> Finding:
    """Returns the finding of the Coulomb friction, by the torque balance and by the decay of the unclamped link."""
    title = "Coulomb friction"
    if hub is None and release is None:
        return Finding("coulomb", title, (), "no recording in which a free hub slides for long enough")
    sentences = _coulomb_by_balance(hub, joint) if hub else []
    if hub and not hub.accepted:
        hub = None
    sentences += _above_static(hub, joint, static_level)
    sentences.append(_coulomb_by_decay(release))
    if hub and release and release.level:
        sentences.append(agreement(hub.coulomb_mean, release.level, ("The balance", "the decay")))
    return Finding("coulomb", title, tuple(sentences))


def _coulomb_by_balance(hub: Balance, joint: JointEstimate) -> list[str]:
    explained = f"explains {100 * hub.determination:.3g} % of the torque's variance"
    if not hub.accepted:
        return [
            f"The hub's torque balance {explained}: the model lacks torques on the hub, so that it gives no level."
        ]
    sentences = [
        f"By the hub's torque balance: {format_estimate(hub.coulomb_mean, 'N*m')}.",
        f"Towards positive angles {format_estimate(hub.coulomb[1], 'N*m')}, "
        f"towards negative ones {format_estimate(hub.coulomb[-1], 'N*m')}.",
        f"The balance {explained}.",
    ]
    if "coulomb_friction" in joint.names:
        estimate = joint.estimate("coulomb_friction")
        sentences.append(agreement(hub.coulomb_mean, estimate, ("The balance", "the joint estimate")))
    return sentences


def _above_static(hub: Balance | None, joint: JointEstimate, static_level: Estimate | None) -> list[str]:
    """A sentence where the Coulomb level exceeds the static one, which dry friction cannot."""
    if hub:
        level = hub.coulomb_mean
    elif "coulomb_friction" in joint.names:
        level = joint.estimate("coulomb_friction")
    else:
        return []
    if static_level is None or level.value <= static_level.value:
        return []
    if normalised_difference(level, static_level) <= DISAGREEMENT:
        return []
    subject = "That" if hub else f"The joint estimate, {format_estimate(level, 'N*m')},"
    return [f"{subject} exceeds the static friction, as dry friction cannot: part of it grows with the rate."]


def _coulomb_by_decay(release: FrictionMap | None) -> str:
    head = "By the decay of the unclamped link"
    if release is None:
        return (
            f"{head}: no unclamped recording that declares the tip deflection at its start swings five times."
        )
    head = f"{head} ({release.recording})"
    measured = format_estimate(release.measured)
    if release.level is None:
        return f"{head}: no simulated Coulomb friction gives its equivalent damping ratio, {measured}."
    return (
        f"{head}, with an equivalent damping ratio of {measured} and simulations from a deflection of "
        f"{1e3 * release.deflection:.3g} mm, which gives swings as large as measured: "
        f"{format_estimate(release.level, 'N*m')}."
    )


def inertia(
    hub: Balance | None,
    momentum: MomentumBalance | None,
    total: Estimate,
    tip_mass: Estimate | None,
    joint: JointEstimate | None,
) -> Finding:
    """Returns the finding of the inertias and the payload; a balance that is not accepted is left out.

    Args:
      hub: torque balance of the hub.
      momentum: balance of the rig's angular momentum.
      total: total inertia by the joint estimate [kg m^2].
      tip_mass: by both balances [kg].
      joint: joint estimate.
    """
    title = "Inertias and payload from slews"
    if hub is None and momentum is None:
        return Finding("inertia", title, (), "no recording in which a free hub slides for long enough")
    sentences = []
    if hub is not None and hub.accepted:
        sentences += _hub_inertia(
            hub.inertia if joint is None else with_link_uncertainty(hub.inertia, joint), joint
        )
    if momentum is not None and momentum.accepted:
        sentences.append(
            f"Total inertia {format_estimate(momentum.inertia, 'kg*m^2')} by the angular momentum of the rig."
        )
        sentences.append(agreement(momentum.inertia, total, ("It", "that of the joint estimate")))
    elif sentences:
        sentences.append(_missing_total_inertia(momentum))
    if tip_mass is not None:
        sentences += _tip_mass(tip_mass, joint)
    if not sentences:
        missing = "the balance explains too little of the hub's torque: the model lacks torques on the hub"
        return Finding("inertia", title, (), missing)
    return Finding("inertia", title, tuple(sentences))


def _hub_inertia(inertia: Estimate, joint: JointEstimate | None) -> list[str]:
    if not inertia.informative:
        share = 100 * inertia.standard_error / abs(inertia.value)
        return [
            f"The hub's torque balance does not determine its inertia: the standard error is {share:.0f} % of it."
        ]
    sentences = [f"Hub inertia {format_estimate(inertia, 'kg*m^2')} by the hub's torque balance."]
    if joint is not None and "hub_inertia" in joint.names:
        sentences.append(agreement(inertia, joint.estimate("hub_inertia"), ("It", "the joint estimate")))
    return sentences


def _missing_total_inertia(momentum: MomentumBalance | None) -> str:
    head = "The total inertia, and the payload by it, are missing: "
    if momentum is not None:
        return (
            f"{head}its balance explains {100 * momentum.determination:.0f} % of the hub's motion, the model lacks "
            "torques on the hub."
        )
    return (
        f"{head}no recordings with two strain gauges in which the hub slides without a stop often enough, "
        "one slew there and one back in each of six, say."
    )


def _tip_mass(tip_mass: Estimate, joint: JointEstimate | None) -> list[str]:
    value = format_estimate(tip_mass, "kg")
    sentences = [
        f"Payload {value} by the total inertia less that of the hub, and those of link and payload as declared."
    ]
    if joint is not None and "tip_mass" in joint.names:
        sentences.append(agreement(tip_mass, joint.estimate("tip_mass"), ("It", "the joint estimate")))
    return sentences


def spectra(
    response: Response | None, modes: Sequence[Mode], curve: Backbone | None, first: Estimate
) -> Finding:
    """Returns the finding of the frequency responses.

    Args:
      response: of the link to the torque.
      modes: resonances with a free hub.
      curve: backbone of the first resonance.
      first: first frequency of small vibration by the joint estimate [Hz].
    """
    title = "Spectra of torque sweeps"
    if response is None:
        return Finding("spectra", title, (), "no recording from rest whose torque excites a broad band")
    sentences = [
        f"Response of {labels.with_the(response.channel)} to the torque, from {', '.join(response.recordings)}."
    ]
    if response.by_reference:
        sentences.append(
            "The loop was closed: the response is by the reference as instrumental variable, because noise that the "
            "controller feeds back is in the torque, and in H1, H2 and Hv."
        )
    sentences += [_mode(mode) for mode in modes]
    sentences += _shifted_first_mode(modes, first)
    if curve is None:
        sentences.append(
            f"How the resonance depends on amplitude: fewer than {MIN_SWEEPS} recordings show it by themselves."
        )
    else:
        sentences += _backbone(curve)
    return Finding("spectra", title, tuple(sentences))


def _mode(mode: Mode) -> str:
    damping = f", damping ratio {format_estimate(mode.damping_ratio)}" if mode.damping_ratio else ""
    kind = "a bending mode of this rig" if mode.kind == "bending" else "no bending mode of this rig"
    return f"{format_estimate(mode.frequency, 'Hz')}{damping}: {kind}."


def _shifted_first_mode(modes: Sequence[Mode], first: Estimate) -> list[str]:
    """A sentence where the first peak of a sweep is not at the frequency of small vibration."""
    near = [
        m.frequency
        for m in modes
        if m.kind == "bending" and abs(m.frequency.value / first.value - 1) < SOFTENING_TOLERANCE
    ]
    if not (near and first.informative and normalised_difference(near[0], first) > DISAGREEMENT):
        return []
    return [
        f"By the joint estimate the first mode has {format_estimate(first, 'Hz')} in small vibration: hub friction and "
        "large bends shift the peak of a sweep."
    ]


def _backbone(curve: Backbone) -> list[str]:
    word = "shifts" if curve.depends_on_amplitude else "does not shift significantly"
    head = (
        f"The first resonance {word} with amplitude: {format_estimate(curve.small_amplitude, 'Hz')} "
        f"for small vibration, {_percent(curve.slope)} at the largest."
    )
    if curve.simulated_slope is None or curve.residual_slope is None:
        return [
            head,
            "Hub friction and large bends shift it too, and no simulation of these sweeps shows by how much: "
            "this alone is no evidence of a softening link.",
        ]
    simulated = labels.signed(100 * curve.simulated_slope, 2)
    evidence = (
        "evidence of a softening link, or of something else that the model lacks"
        if curve.differs_from_model
        else "no evidence of a softening link"
    )
    return [
        head,
        f"The identified model, without softening, shifts by {simulated} % in the same sweeps, "
        f"by hub friction and large bends; measured over simulated by {_percent(curve.residual_slope)}: {evidence}.",
    ]


def _percent(change: Estimate) -> str:
    low, high = change.interval
    value, first, last = (labels.signed(100 * x, 2) for x in (change.value, low, high))
    return f"{value} % ({first} to {last})"


def campaigns_compared(comparison: Comparison) -> Finding:
    """Returns the finding on the peaks of two campaigns of the rig."""
    title = f"Peaks beside those of {comparison.campaign}"
    if comparison.missing is not None or not (comparison.peaks or comparison.appeared):
        missing = comparison.missing or f"no peak in a band that {comparison.campaign} excites"
        return Finding("against", title, (), missing)
    changed = [
        f"{labels.words(name)} {here:.4g} here and {there:.4g} there"
        for name, (here, there) in comparison.changed.items()
    ]
    rigs = (
        f"Declared: {', '.join(changed)}."
        if changed
        else "The two declare one rig, so that bending modes do not shift."
    )
    sentences = [_paired_peak(peak) for peak in comparison.peaks]
    sentences += [_unpaired_peak(peak, comparison.campaign) for peak in comparison.appeared]
    return Finding("against", title, (rigs, *sentences))


def _paired_peak(peak: PairedPeak) -> str:
    expected = 100 * (peak.bending_hz / peak.frequency_hz - 1)
    if peak.other_hz is None:
        rest = f"{100 * peak.height:.0f} % of its height is left"
        if peak.vanished:
            return f"{peak.frequency_hz:.4g} Hz is gone ({rest}): no bending mode of the link."
        return f"{peak.frequency_hz:.4g} Hz is no clear peak there, but {rest}: its kind is undetermined."
    shift = 100 * (peak.other_hz / peak.frequency_hz - 1)
    moved, as_bending = labels.signed(shift, 1), labels.signed(expected, 1)
    kind = "a bending mode" if peak.kind == "bending" else "no bending mode"
    return f"{peak.frequency_hz:.4g} Hz shifts by {moved} %, a bending mode would by {as_bending} %: {kind}."


def _unpaired_peak(peak: PairedPeak, campaign: str) -> str:
    where = f"{peak.frequency_hz:.4g} Hz is a clear peak in {campaign} only"
    if peak.kind == "bending":
        return f"{where}, where this rig has a bending mode."
    if peak.vanished:
        return f"{where}: no bending mode of the link."
    return f"{where}, but {100 * peak.height:.0f} % of its height is here too: its kind is undetermined."
