"""What each procedure found, in words: numbers with intervals, the evidence against them, what is lacking."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from scipy.constants import g

from twin.identification.backbone import LEAST_SWEEPS, Backbone
from twin.identification.balance import Balance
from twin.identification.break_away import StaticFriction
from twin.identification.compare_campaigns import Comparison, PairedPeak
from twin.identification.decay import Decay
from twin.identification.estimates import Estimate, Finding, Mode, disagreement
from twin.identification.friction_map import FrictionMap
from twin.identification.held_out import HeldOutError
from twin.identification.joint import Joint, with_link
from twin.identification.near_modes import SOFTER
from twin.identification.spectra import Response
from twin.identification.static_test import LOADS, OddRow, StaticTest
from twin.identification.total_inertia import Momentum

_FEWEST, _MOST = 4, 9  # digits of a number
_ODD_SHOWN = 3  # contradictions between recordings
_APART = 3.0  # standard errors of the difference from which two estimates are said to disagree


def shown(estimate: Estimate, unit: str = "") -> str:
    """The value, its 95 % interval and unit: `0.2482 (0.2470 to 0.2494) N m^2`."""
    low, high = estimate.interval
    digits = _FEWEST
    if high > low and estimate.value:
        # Two digits of half the interval.
        digits = min(max(_FEWEST, 2 + math.ceil(math.log10(2 * abs(estimate.value) / (high - low)))), _MOST)
    return f"{estimate.value:.{digits}g} ({low:.{digits}g} to {high:.{digits}g}) {unit}".rstrip()


def agreement(a: Estimate, b: Estimate, names: tuple[str, str]) -> str:
    """Whether two estimates of one quantity agree."""
    apart = disagreement(a, b)
    word = "agree" if apart < _APART else "disagree"
    return f"{names[0]} and {names[1]} {word}: {apart:.1f} standard errors of their difference apart."


def static(load: StaticTest | None, declared: Estimate) -> Finding:
    """The static test; `declared` is the stiffness that the campaign says."""
    title = "Stiffness from a static test"
    if load is None:
        columns = " or ".join(LOADS)
        return Finding("static", title, (), f"no static.csv with tip_deflection beside {columns}")
    said = []
    if load.stiffness is not None:
        said.append(
            f"{_elastic(load)} by a line with its own zero through {len(load.line.x)} loads, {_line_errors(load)}."
        )
        if abs(load.line.intercept.value) > 2 * load.line.intercept.standard_error:
            said.append(
                f"The line crosses zero displacement {_tare(load)} below no load: what else hung there, or the zero "
                "of the ruler."
            )
        if declared.standard_error > 0:
            said.append(agreement(load.stiffness, declared, ("The static test", "the declared stiffness")))
    else:
        assert load.curvature is not None
        said.append(
            f"No load was recorded, so that no stiffness follows; one unit of {load.column} is a curvature of "
            f"{shown(load.curvature, '1/m')} at the hub, the errors of both alike in parts of their ranges."
        )
    if load.odd is not None:
        said += _odd_row(load.odd)
    p = load.line.curvature_probability
    if p == p:
        word = "straight" if load.line.straight else "bent"
        said.append(
            f"The line is {word}: chance alone makes a parabola this much better with probability {p:.2g}."
        )
    return Finding("static", title, tuple(said))


def _elastic(load: StaticTest) -> str:
    """EI, and E where I was given."""
    assert load.stiffness is not None
    said = f"EI = {shown(load.stiffness, 'N m^2')}"
    if load.modulus is None:
        return said
    return f"{said}, E = {shown(load.modulus, 'Pa')} with the I that was given,"


def _line_errors(load: StaticTest) -> str:
    x, y = load.errors
    if not (x > 0 and y > 0):
        return "the loads taken as exact"
    return f"load and displacement as uncertain as their last decimals, {x:.2g} N and {1e3 * y:.2g} mm"


def _tare(load: StaticTest) -> str:
    force = f"{load.tare:.3g} N"
    return f"{force} ({load.tare / g:.3g} kg)" if load.column == "tip_load_mass" else force


def _odd_row(odd: OddRow) -> list[str]:
    name, others = f"row {odd.row + 1}", odd.others
    said = [
        f"{name.capitalize()} lies {1e3 * odd.away:+.3g} mm off the line through the others: a slip, or a bent line."
    ]
    if others.stiffness is not None:
        said.append(f"Without it {_elastic(others).removesuffix(',')}, tare = {_tare(others)}.")
    elif others.curvature is not None:
        said.append(f"Without it one unit is {shown(others.curvature, '1/m')}.")
    if odd.alone is not None:
        said.append(f"With that tare {name} by itself gives EI = {odd.alone:.4g} N m^2.")
    return said


def decays(found: Sequence[Decay]) -> Finding:
    """The ring-downs."""
    title = "Damping from free vibration"
    if not found:
        return Finding(
            "decay",
            title,
            (),
            "no clamped recording, and no rest of the hub, in which the link rings for four periods",
        )
    said = []
    for d in found:
        where = f"{d.recording}, {d.channel}, {d.time[0]:.1f} to {d.time[-1]:.1f} s"
        said.append(f"{where}: {shown(d.frequency, 'Hz')}, damping ratio {shown(d.damping_ratio)}.")
        said.append(agreement(d.by_decrement, d.by_fit, ("Logarithmic decrement", "fit of the decay")))
        if d.law == "proportional":
            said.append(
                "The envelope is exponential: losses in proportion to the rate, no friction or air needed."
            )
        else:
            said.append(
                f"The envelope needs a loss by {d.law}, {d.law_significance:.0f} standard errors from none."
            )
        if abs(d.frequency_slope.value) > 4 * d.frequency_slope.standard_error:
            change = 100 * d.frequency_slope.value
            said.append(
                f"At its first amplitude the frequency is {change:+.2f} % off that of small vibration."
            )
    return Finding("decay", title, tuple(said))


def break_aways(found: StaticFriction) -> Finding:
    """The static friction."""
    title = "Break-away friction from slow ramps"
    if found.level is None:
        return Finding(
            "break-away", title, (), "no recording in which a slowly growing torque ends a rest of the hub"
        )
    many = f"{len(found.events)} break-away{'s' if len(found.events) > 1 else ''}"
    said = [f"{many}; static friction {shown(found.level, 'N m')}."]
    for direction, level in found.by_direction.items():
        said.append(f"Towards {'positive' if direction > 0 else 'negative'} angles {shown(level, 'N m')}.")
    if len(found.by_direction) == 2:
        said.append(
            agreement(found.by_direction[1], found.by_direction[-1], ("The two directions", "each other"))
        )
    if found.angle_spread == found.angle_spread:
        said.append(
            f"Standard deviation over the angles at which they were read: {found.angle_spread:.2g} N m."
        )
    return Finding("break-away", title, tuple(said))


def coulomb(
    hub: Balance | None, released: FrictionMap | None, found: Joint, level: Estimate | None
) -> Finding:
    """The Coulomb friction by the torque balance and by the decay of the unclamped link; `level` is the static one."""
    title = "Coulomb friction"
    if hub is None and released is None:
        return Finding("coulomb", title, (), "no recording in which a free hub slides for long enough")
    said = _of_balance(hub, found) if hub else []
    if hub and not hub.believed:
        hub = None
    sliding = (
        hub.both if hub else found.estimate("coulomb_friction") if "coulomb_friction" in found.names else None
    )
    if sliding and level and sliding.value > level.value and disagreement(sliding, level) > _APART:
        whose = "That" if hub else f"The joint estimate, {shown(sliding, 'N m')},"
        said.append(
            f"{whose} is more than the resting hub bore, which dry friction cannot be: part of it grows with the rate."
        )
    if released is None:
        said.append(
            "By the decay of the unclamped link: no unclamped recording with initial_tip_deflection swings five times."
        )
    elif released.level is None:
        said.append(
            f"By the decay of the unclamped link ({released.recording}): its equivalent damping ratio, "
            f"{shown(released.measured)}, is none that a simulation gives for any Coulomb friction."
        )
    else:
        said.append(
            f"By the decay of the unclamped link ({released.recording}), with an equivalent damping ratio of "
            f"{shown(released.measured)} and a map by simulation from {1e3 * released.deflection:.3g} mm, with which "
            f"the swings are as large as measured: {shown(released.level, 'N m')}."
        )
        if hub:
            said.append(agreement(hub.both, released.level, ("The balance", "the decay")))
    return Finding("coulomb", title, tuple(said))


def _of_balance(hub: Balance, found: Joint) -> list[str]:
    explained = f"explains {100 * hub.determination:.3g} % of the torque's variance"
    if not hub.believed:
        return [
            f"The hub's torque balance {explained}: the hub obeys other laws beside, and it tells no level."
        ]
    said = [
        f"By the hub's torque balance: {shown(hub.both, 'N m')}.",
        f"Towards positive angles {shown(hub.coulomb[1], 'N m')}, "
        f"towards negative ones {shown(hub.coulomb[-1], 'N m')}.",
        f"The balance {explained}.",
    ]
    if "coulomb_friction" in found.names:
        said.append(
            agreement(hub.both, found.estimate("coulomb_friction"), ("The balance", "the joint estimate"))
        )
    return said


def inertia(
    hub: Balance | None,
    whole: Momentum | None,
    total: Estimate,
    tip_mass: Estimate | None,
    found: Joint | None,
) -> Finding:
    """The inertias and the payload; a balance that explains too little is left out."""
    title = "Inertias and payload from slews"
    if hub is None and whole is None:
        return Finding("inertia", title, (), "no recording in which a free hub slides for long enough")
    said = []
    if hub is not None and hub.believed:
        said += _of_hub(hub.inertia if found is None else with_link(hub.inertia, found), found)
    if whole is not None and whole.believed:
        said.append(f"J = {shown(whole.inertia, 'kg m^2')} of the whole rig by its angular momentum.")
        said.append(agreement(whole.inertia, total, ("It", "that of the joint estimate")))
    elif said and whole is not None:
        said.append(
            "The total inertia, and the payload by it, are missing: its balance explains "
            f"{100 * whole.determination:.0f} % of how the hub turns, other laws act on it."
        )
    elif said:
        said.append(
            "The total inertia, and the payload by it, are missing: no recordings with two strain gauges in which the "
            "hub slides on often enough, one slew there and one back in each of six, say."
        )
    if tip_mass is not None:
        said.append(
            f"Payload {shown(tip_mass, 'kg')} by (J - J0 - rho l^3/3 - J_p)/l^2, the link and J_p as declared."
        )
        if found is not None and "tip_mass" in found.names:
            said.append(agreement(tip_mass, found.estimate("tip_mass"), ("It", "the joint estimate")))
    if not said:
        return Finding(
            "inertia", title, (), "the balance explains too little of the hub's torque: other laws act on it"
        )
    return Finding("inertia", title, tuple(said))


def _of_hub(inertia: Estimate, found: Joint | None) -> list[str]:
    if not inertia.told:
        share = 100 * inertia.standard_error / abs(inertia.value)
        return [f"The hub's torque balance does not tell J0: its standard error is {share:.0f} % of it."]
    said = [f"J0 = {shown(inertia, 'kg m^2')} by the hub's torque balance."]
    if found is not None and "hub_inertia" in found.names:
        said.append(agreement(inertia, found.estimate("hub_inertia"), ("It", "the joint estimate")))
    return said


def spectra(
    found: Response | None, modes: Sequence[Mode], moved: Backbone | None, small: Estimate
) -> Finding:
    """The frequency responses; `small` is the first frequency of small vibration by the joint estimate."""
    title = "Spectra of torque sweeps"
    if found is None:
        return Finding("spectra", title, (), "no recording from rest whose torque excites a broad band")
    said = [f"{found.channel} over torque, from {', '.join(found.recordings)}."]
    if found.by_reference:
        said.append(
            "The loop was closed: the response is by the reference as instrument, because noise that the controller "
            "feeds back is in the torque, and in H1, H2 and Hv."
        )
    for mode in modes:
        damping = f", damping ratio {shown(mode.damping_ratio)}" if mode.damping_ratio else ""
        what = "a bending mode of this rig" if mode.kind == "bending" else "no bending mode of this rig"
        said.append(f"{shown(mode.frequency, 'Hz')}{damping}: {what}.")
    firsts = [
        m.frequency
        for m in modes
        if m.kind == "bending" and abs(m.frequency.value / small.value - 1) < SOFTER
    ]
    if firsts and small.told and disagreement(firsts[0], small) > _APART:
        said.append(
            f"By the joint estimate the first mode has {shown(small, 'Hz')} in small vibration: friction of the hub "
            "and large bends move the peak of a sweep."
        )
    if moved is None:
        said.append(
            f"How the resonance moves with amplitude: fewer than {LEAST_SWEEPS} recordings show it by themselves."
        )
    else:
        said += _backbone(moved)
    return Finding("spectra", title, tuple(said))


def _backbone(found: Backbone) -> list[str]:
    word = "moves" if found.moves else "does not move visibly"
    said = [
        f"The first resonance {word} with amplitude: {shown(found.small, 'Hz')} for small vibration, "
        f"{_percent(found.slope)} at the largest."
    ]
    if found.simulated is None or found.beyond is None:
        return [
            *said,
            "Friction of the hub and large bends move it too, and no simulation of these sweeps shows by how much: "
            "this is no softening of the link by itself.",
        ]
    left = (
        "a softening link, or what else the model lacks"
        if found.softens
        else "nothing is left for a softening link"
    )
    said.append(
        f"The identified model, without softening, moves by {100 * found.simulated:+.2f} % in the same sweeps, by the "
        f"friction of its hub and large bends; measured over simulated by {_percent(found.beyond)}: {left}."
    )
    return said


def _percent(change: Estimate) -> str:
    low, high = change.interval
    return f"{100 * change.value:+.2f} % ({100 * low:+.2f} to {100 * high:+.2f})"


def compared(found: Comparison) -> Finding:
    """The peaks beside those of another campaign of the rig."""
    title = f"Peaks beside those of {found.campaign}"
    if found.missing is not None or not (found.peaks or found.appeared):
        return Finding(
            "against", title, (), found.missing or f"no peak in a band that {found.campaign} excites"
        )
    changed = [
        f"{name} {here:.4g} here and {there:.4g} there" for name, (here, there) in found.changed.items()
    ]
    rigs = (
        f"Declared: {', '.join(changed)}."
        if changed
        else "The two declare one rig, so that bending modes stay where they are."
    )
    said = [_paired(peak) for peak in found.peaks]
    said += [_appeared(peak, found.campaign) for peak in found.appeared]
    return Finding("against", title, (rigs, *said))


def _paired(peak: PairedPeak) -> str:
    expected = 100 * (peak.bending_hz / peak.frequency_hz - 1)
    rule = f"a bending mode would by {expected:+.1f} %"
    if peak.other_hz is None:
        left = f"{100 * peak.height:.0f} % of its height is left"
        if peak.gone:
            return f"{peak.frequency_hz:.4g} Hz is gone ({left}): no bending mode of the link."
        return f"{peak.frequency_hz:.4g} Hz is no clear peak there, but {left}: its kind stays open."
    moved = 100 * (peak.other_hz / peak.frequency_hz - 1)
    what = "a bending mode" if peak.kind == "bending" else "no bending mode"
    return f"{peak.frequency_hz:.4g} Hz moves by {moved:+.1f} %, {rule}: {what}."


def _appeared(peak: PairedPeak, campaign: str) -> str:
    where = f"{peak.frequency_hz:.4g} Hz is a clear peak in {campaign} only"
    if peak.kind == "bending":
        return f"{where}, where this rig has a bending mode."
    if peak.gone:
        return f"{where}: no bending mode of the link."
    return f"{where}, but {100 * peak.height:.0f} % of its height is here too: its kind stays open."


def joint(
    found: Joint, figures: Mapping[str, tuple[Estimate, str]], predicted: Sequence[HeldOutError]
) -> Finding:
    """The joint estimate: what moves together, what follows from it, how it was checked, and what it predicts."""
    count = len(found.recordings)
    said = [
        f"{len(found.names)} parameters from {count} recording{'s' if count > 1 else ''}, "
        "each with its declared uncertainty as prior."
    ]
    for a, b, r in found.tied()[:5]:
        way = "together" if r > 0 else "against each other"
        power, error = found.combination(a, b)
        alone = [100 * e.standard_error / abs(e.value) for e in (found.estimate(a), found.estimate(b))]
        said.append(
            f"{a} and {b} move {way} (correlation {r:.3f}): {a} times {b} to the power {power:.2g} is known to "
            f"{100 * error:.2g} %, each alone to {alone[0]:.2g} and {alone[1]:.2g} %."
        )
    for what, (value, unit) in figures.items():
        if value.told:
            comma = "," if "," in what else ""
            said.append(f"Together they give {what}{comma} of {shown(value, unit)}.")
        else:
            said.append(f"Together they do not tell {what}.")
    said += [
        f"{name} stands at the end of its range: what was declared of it is wrong, or the model lacks something."
        for name in found.at_an_end()
    ]
    said += [
        f"Without {recording} {name} moves by {distance:.3g} standard errors of the move: the recordings contradict "
        "each other, which the model does not explain."
        for recording, name, distance in found.odd[:_ODD_SHOWN]
    ]
    if count == 1:
        said.append("There is no other recording that it could be checked against.")
    elif not found.odd:
        said.append("No recording moves the estimate by more than chance when it is left out.")
    said += [
        f"The likelihood is not elliptic in {name}: the 95 % interval, by its profile, is {low:.5g} to {high:.5g}"
        f"{_open(found.open_ends(name))}."
        for name, (low, high) in found.intervals.items()
    ]
    rest = [name for name in found.not_elliptic() if name not in found.intervals]
    if rest:
        said.append(
            f"The likelihood is not elliptic in {', '.join(rest)}, but where recordings contradict each other "
            "its profile tells no interval: theirs are those of the covariance."
        )
    elif not found.intervals:
        said.append(
            "Two standard errors away the likelihood is what the covariance says, in every parameter."
        )
    return Finding("joint", "Joint estimate", (*said, *_of_held_out(predicted)))


def _of_held_out(errors: Sequence[HeldOutError]) -> list[str]:
    """How far the identified rig is off recordings that were held out, at worst."""
    hub = max(
        (e for e in errors if e.channel == "hub_angle"), key=lambda e: e.windowed / e.noise, default=None
    )
    steps = [(e.by_steps / e.noise, e) for e in errors if e.by_steps is not None]
    link = max(steps, key=lambda pair: pair[0], default=None)
    parts = []
    if hub is not None:
        parts.append(f"{hub.windowed / hub.noise:.2g} noise levels of hub_angle in windows ({hub.recording})")
    if link is not None:
        parts.append(f"{link[0]:.2g} of {link[1].channel} by steps ({link[1].recording})")
    if not parts:
        return []
    return [
        f"Held-out recordings are predicted to {' and '.join(parts)} at worst. Noise alone is 1, by steps less: "
        "well above it, sticking begins or ends at another instant, or the model lacks something that `twin diagnose` "
        "looks for."
    ]


def _open(sides: Sequence[str]) -> str:
    """What an interval says that ends where the range of its parameter does."""
    if not sides:
        return ""
    ends = f"{' and '.join(sides)} end{'s are those' if len(sides) > 1 else ' is that'}"
    return f", and its {ends} of the range looked at"
