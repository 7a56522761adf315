"""What an identification found and what stands against it, in two sentences, for page and terminal."""

from __future__ import annotations

from twin import labels
from twin.identification.estimates import Identified
from twin.identification.result import Identification
from twin.report.display import NOISE_LIKE

FAR = 2.0
"""Declared standard deviations [1] from which a parameter is far from its declared value."""


def headline(result: Identification) -> str:
    """Returns how many parameters are determined, or that the recordings contradict the model."""
    if not result.trust.trusted:
        return "The recordings contradict the model: its parameters are not identified."
    count, known = len(result.all_parameters), len(result.all_parameters) - len(result.not_determined)
    return f"The recordings determine {known if known < count else 'all'} of {count} declared parameters."


def caveat(result: Identification) -> str:
    """Returns what stands against the headline, or why the model is contradicted and what to do."""
    if not result.trust.trusted:
        return (
            f"{result.trust.reason} A model that lacks an effect has no honest intervals: the values below fit these "
            "recordings best, and their intervals are withheld. Use twin diagnose, which says what the model lacks."
        )
    far = [name for name, p in result.all_parameters.items() if abs(change(p) or 0.0) > FAR]
    if far:
        moved = labels.join_with_and([labels.parameter(name) for name in far])
        return (
            f"{labels.sentence(moved)} moved by more than two declared standard deviations: doubt the "
            "declaration, or the model."
        )
    unseen = _missed(result)
    if unseen:
        return unseen
    if result.not_determined:
        names = [labels.parameter(name) for name in result.not_determined]
        return f"They do not determine {labels.join_with_and(names)}."
    return "All are within two of their declared standard deviations."


def change(p: Identified) -> float | None:
    """Returns the distance from the declared value [declared standard deviations]; None where none is declared."""
    return (p.value - p.declared) / p.declared_error if p.declared_error else None


def _missed(result: Identification) -> str:
    """Where the identified rig fails most on held-out recordings, in a sentence; "" where it does not."""
    off = [(labels.over_noise(e.identified, e.noise), e) for e in result.held_out]
    off = [(over, e) for over, e in off if over > NOISE_LIKE]
    if not off:
        return ""
    _, worst = max(off, key=lambda pair: pair[0])
    return (
        f"From its first sample and its command alone, {worst.recording} is not predicted: "
        f"{labels.with_the(worst.channel)} is off by {labels.amount(worst.channel, worst.identified)}, and its "
        f"sensor's noise is {labels.amount(worst.channel, worst.noise)}. With the hub at rest and in motion when the "
        "measured one is, it is predicted: a stick begins or ends at another instant."
    )
