"""The joint estimate in sentences: correlations, derived quantities, checks, intervals and prediction errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from twin import labels
from twin.identification.derived import DerivedQuantity
from twin.identification.estimates import Finding
from twin.identification.held_out import HeldOutError
from twin.identification.joint import JointEstimate
from twin.identification.text import format_estimate, format_interval

_MAX_PAIRS = 5  # correlated pairs that are printed
_MAX_CONTRADICTIONS = 3  # contradictions between recordings that are printed


def joint_finding(
    joint: JointEstimate,
    derived: Iterable[DerivedQuantity],
    held_out: Sequence[HeldOutError],
    trusted: bool = True,
) -> Finding:
    """Returns the finding of the joint estimate.

    Args:
      joint: the joint estimate.
      derived: quantities that follow from it.
      held_out: prediction errors of the identified rig.
      trusted: false withholds errors and intervals.
    """
    count = len(joint.recordings)
    head = (
        f"{len(joint.names)} parameters from {count} recording{'s' if count > 1 else ''}, "
        "each with its declared uncertainty as prior."
    )
    return Finding(
        "joint",
        "Joint estimate",
        (
            head,
            *_correlations(joint, trusted),
            *(_derived_quantity(quantity, trusted) for quantity in derived),
            *_bounds(joint),
            *_contradictions(joint),
            *(_intervals(joint) if trusted else ()),
            *_prediction_errors(held_out),
        ),
    )


def _correlations(joint: JointEstimate, trusted: bool) -> Iterator[str]:
    for a, b, r in joint.correlated_pairs()[:_MAX_PAIRS]:
        first, second = labels.parameter(a), labels.parameter(b)
        tied = f"{first} and {second} are strongly correlated ({r:.3f})"
        if not trusted:
            yield f"{labels.sentence(tied)}."
            continue
        power, error = joint.best_known_product(a, b)
        single = [100 * e.standard_error / abs(e.value) for e in (joint.estimate(a), joint.estimate(b))]
        shares = [labels.number(share, 2) for share in (100 * error, *single)]
        yield (
            f"{labels.sentence(tied)}: {first} times {second} to the power {labels.number(power, 2)} is known to "
            f"{shares[0]} %, each alone to {shares[1]} and {shares[2]} %."
        )


def _derived_quantity(quantity: DerivedQuantity, trusted: bool) -> str:
    label = quantity.label
    if not quantity.estimate.informative:
        return f"The joint estimate does not determine {label}."
    comma = "," if "," in label else ""
    value = (
        f"{labels.number(quantity.estimate.value, labels.PAGE_DIGITS)} {labels.unit(quantity.unit)}".rstrip()
    )
    shown = format_estimate(quantity.estimate, quantity.unit) if trusted else value
    return f"The joint estimate gives {label}{comma} of {shown}."


def _bounds(joint: JointEstimate) -> Iterator[str]:
    for name in joint.at_bounds():
        subject = labels.sentence(labels.parameter(name))
        yield f"{subject} is at a bound of its range: the declaration is wrong, or the model lacks something."


def _contradictions(joint: JointEstimate) -> Iterator[str]:
    for recording, name, distance in joint.contradictions[:_MAX_CONTRADICTIONS]:
        yield (
            f"Without {recording} the {labels.parameter(name)} moves by {labels.ratio(distance)} standard errors: the "
            "recordings contradict each other, which the model does not explain."
        )
    if len(joint.recordings) == 1:
        yield "There is no other recording that it could be checked against."
    elif not joint.contradictions:
        yield "No recording moves the estimate by more than chance when it is left out."


def _intervals(joint: JointEstimate) -> Iterator[str]:
    for name in joint.intervals:
        yield (
            f"The log-likelihood is not quadratic in {labels.parameter(name)}: the 95 % interval by profile "
            f"likelihood is {format_interval(joint.estimate(name))}{_truncation(joint.truncated_sides(name))}."
        )
    rest = [name for name in joint.non_quadratic() if name not in joint.intervals]
    if rest:
        names = ", ".join(map(labels.parameter, rest))
        yield (
            f"The log-likelihood is not quadratic in {names}, but where recordings contradict each other "
            "its profile gives no interval: theirs are those of the covariance."
        )
    elif not joint.intervals:
        yield "Within two standard errors the log-likelihood is quadratic in every parameter."


def _truncation(sides: Sequence[str]) -> str:
    """Clause on the ends of an interval that are bounds of its parameter; "" without any."""
    if not sides:
        return ""
    plural = len(sides) > 1
    return (
        f", and its {' and '.join(sides)} end{'s are bounds' if plural else ' is a bound'} of the parameter"
    )


def _prediction_errors(errors: Sequence[HeldOutError]) -> Iterator[str]:
    """The largest errors on held-out recordings; nothing without any."""
    hub = max(
        (e for e in errors if e.channel == "hub_angle"), key=lambda e: e.windowed / e.noise, default=None
    )
    steps = [(e.by_steps / e.noise, e) for e in errors if e.by_steps is not None]
    link = max(steps, key=lambda pair: pair[0], default=None)
    parts = []
    if hub is not None:
        over = labels.ratio(hub.windowed / hub.noise)
        parts.append(f"{over} noise levels of the hub angle in windows ({hub.recording})")
    if link is not None:
        parts.append(
            f"{labels.ratio(link[0])} of {labels.with_the(link[1].channel)} by steps ({link[1].recording})"
        )
    if parts:
        yield (
            f"Held-out recordings are predicted to {' and '.join(parts)} at worst. Noise alone is 1, by steps less: "
            "well above it, sticking begins or ends at another instant, or the model lacks something that "
            "twin diagnose looks for."
        )
