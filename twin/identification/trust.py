"""Whether an identification is trusted: recordings that contradict its model, and the reason in sentences.

A model that lacks an effect lets the parameters imitate it: their intervals assume that nothing is missing, and mean
nothing then.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from twin import labels
from twin.identification.derived import DerivedQuantities
from twin.identification.estimates import Estimate, Identified
from twin.identification.held_out import HeldOutError
from twin.identification.joint import JointEstimate
from twin.report.display import NOISE_LIKE


@dataclass(frozen=True)
class Trust:
    """Whether the recordings leave the model of an identification uncontradicted.

    Attributes:
      trusted: false where recordings contradict the model.
      reason: why, in sentences.
    """

    trusted: bool
    reason: str


def trust_in(joint: JointEstimate, held_out: Sequence[HeldOutError]) -> Trust:
    """Returns whether the recordings contradict the model.

    They do where one of them moves the joint estimate by more than chance, or where a held-out one is missed by more
    than twice the noise of a sensor though the hub rests and moves when the measured one does: such an error is no
    stick at another instant.

    Args:
      joint: the joint estimate.
      held_out: prediction errors of the identified rig.
    """
    against = [*_moves(joint), *_misses(held_out)]
    return Trust(False, " ".join(against)) if against else Trust(True, _support(joint, held_out))


def _moves(joint: JointEstimate) -> Iterator[str]:
    for recording, name, distance in joint.contradictions[:1]:
        yield (
            f"The recordings contradict each other: without {recording} the {labels.parameter(name)} moves by "
            f"{labels.ratio(distance)} standard errors."
        )


def _misses(held_out: Sequence[HeldOutError]) -> Iterator[str]:
    """A sentence on the worst channel that is missed; nothing where none is."""
    over, worst = max(((_excess(e), e) for e in held_out), key=lambda pair: pair[0], default=(0.0, None))
    if worst is not None and over > NOISE_LIKE:
        yield (
            f"The held-out {worst.recording} is not predicted: {labels.with_the(worst.channel)} is off by "
            f"{labels.ratio(over)} times its sensor's noise, though the simulated hub rests and moves when the "
            "measured one does."
        )


def _excess(error: HeldOutError) -> float:
    """The error that no stick at another instant explains, over the noise; 0 where the noise is unknown."""
    guided = error.windowed if error.by_steps is None else error.by_steps
    over = labels.over_noise(min(guided, error.identified), error.noise)
    return over if math.isfinite(over) else 0.0


def _support(joint: JointEstimate, held_out: Sequence[HeldOutError]) -> str:
    parts = []
    if len(joint.recordings) > 1:
        parts.append("no recording moves the estimate by more than chance when it is left out")
    if held_out:
        parts.append(
            f"held-out recordings are missed by at most {NOISE_LIKE:g} times the noise of their sensors"
        )
    if not parts:
        return "Nothing tests the model: there is one recording, and none is held out."
    return f"{labels.sentence(', and '.join(parts))}."


def without_intervals(parameter: Identified) -> Identified:
    """Returns a parameter with its values alone; standard errors and intervals are NaN."""
    methods = {name: _alone(e) for name, e in parameter.methods.items()}
    return replace(parameter, standard_error=math.nan, methods=methods, profile=None, interval_by="withheld")


def derived_without_intervals(derived: DerivedQuantities) -> DerivedQuantities:
    """Returns the derived quantities with their values alone."""
    return DerivedQuantities(*(replace(q, estimate=_alone(q.estimate)) for q in derived))


def _alone(estimate: Estimate) -> Estimate:
    return Estimate(estimate.value, math.nan)
