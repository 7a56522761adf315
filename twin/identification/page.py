"""An identification as one HTML page that needs no network."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from twin import labels
from twin.identification import pictures
from twin.identification.estimates import Estimate, Identified
from twin.identification.held_out import HeldOutError
from twin.identification.procedures import Procedures
from twin.identification.result import Identification
from twin.report import pages
from twin.report.display import NOISE_LIKE
from twin.report.pages import Cell, Row, Table

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_FAR = 2.0  # declared standard deviations from which a parameter is far from its declared value


def render(result: Identification) -> str:
    """Returns the page."""
    moves = pictures.moves(result.all_parameters)
    return pages.render(
        "identification/page.html.j2",
        d=result,
        headline=_headline(result),
        caveat=_caveat(result),
        moves=None
        if moves is None
        else pages.figure(moves, {"margin": {"l": 118, "r": 8, "t": 40, "b": 46}}),
        parameters=_parameters(result),
        methods=_methods(result),
        held_out=_held_out(result),
        estimated_start=any(e.start == "estimated" for e in result.held_out),
        sections=[(finding, _figures(result, finding.procedure)) for finding in result.findings],
    )


def _headline(result: Identification) -> str:
    count, known = len(result.all_parameters), len(result.all_parameters) - len(result.not_determined)
    return f"The recordings determine {known if known < count else 'all'} of {count} declared parameters."


def _caveat(result: Identification) -> str:
    far = [name for name, p in result.all_parameters.items() if abs(_change(p) or 0.0) > _FAR]
    if far:
        moved = labels.join_with_and([_name(name) for name in far])
        return (
            f"{moved[:1].upper()}{moved[1:]} moved by more than two declared standard deviations: doubt the "
            "declaration, or the model."
        )
    unseen = _missed(result)
    if unseen:
        return unseen
    if result.not_determined:
        return (
            f"They do not determine {labels.join_with_and([_name(name) for name in result.not_determined])}."
        )
    return "All are within two of their declared standard deviations."


def _missed(result: Identification) -> str:
    """Where the identified rig fails most on held-out recordings, in a sentence; "" where it does not."""
    off = [(labels.over_noise(e.identified, e.noise), e) for e in result.held_out]
    off = [(over, e) for over, e in off if over > NOISE_LIKE]
    if not off:
        return ""
    _, worst = max(off, key=lambda pair: pair[0])
    return (
        f"But the identified rig does not predict what it has not seen: {labels.with_the(worst.channel)} of "
        f"{worst.recording} is off by {labels.amount(worst.channel, worst.identified)}, and its sensor's noise is "
        f"{labels.amount(worst.channel, worst.noise)}. If that is more than a stick or slip, twin diagnose says what "
        "the model lacks."
    )


def _name(name: str) -> str:
    return labels.words(name).replace(".", ": ")


def _change(p: Identified) -> float | None:
    """From the declared value [declared standard deviations]; None where none is declared."""
    return (p.value - p.declared) / p.declared_error if p.declared_error else None


def _with_interval(estimate: Estimate) -> str:
    """The value with half of its 95 % interval."""
    low, high = estimate.interval
    return labels.with_error(estimate.value, (high - low) / 2, labels.PAGE_DIGITS)


def _parameters(result: Identification) -> Table:
    rows: list[Row] = []
    for name, p in result.all_parameters.items():
        change, reason = _change(p), result.not_determined.get(name)
        moved = "–" if change is None else f"{change:+.1f}".replace("-", "−")
        note = f"not determined: {reason}" if reason else ""
        rows.append(
            (
                Cell(_name(name), note=note),
                labels.number(p.declared, labels.PAGE_DIGITS),
                Cell(_with_interval(p.estimate), strong=True),
                labels.unit(p.unit),
                Cell(moved, warns=abs(change or 0.0) > _FAR),
            )
        )
    return Table(
        ("parameter", ">declared", ">identified, ± half its 95 % interval", "unit", ">in declared σ"), rows
    )


def _methods(result: Identification) -> Table:
    """What each procedure finds by itself."""
    rows = [
        (_name(name), labels.words(method), _with_interval(e), labels.unit(p.unit))
        for name, p in result.all_parameters.items()
        for method, e in p.methods.items()
        if method != "joint"
    ]
    return Table(("parameter", "procedure", ">by itself, ± half its 95 % interval", "unit"), rows)


def _held_out(result: Identification) -> Table:
    rows: list[Row] = []
    groups: dict[int, str] = {}
    for e in result.held_out:
        if e.recording not in groups.values():
            groups[len(rows)] = e.recording
        rows.append(_held_out_row(e))
    columns = (
        "channel",
        ">declared",
        ">identified",
        ">sensor noise",
        ">identified, over noise",
        ">following",
        ">in windows",
        ">by steps",
    )
    return Table(columns, rows, groups)


def _held_out_row(e: HeldOutError) -> Row:
    over = labels.over_noise(e.identified, e.noise)
    guided = (e.following, e.windowed, e.by_steps)
    return (
        labels.channel(e.channel).label,
        labels.amount(e.channel, e.declared),
        Cell(labels.amount(e.channel, e.identified), strong=True),
        labels.amount(e.channel, e.noise),
        Cell(labels.ratio(over), warns=over > NOISE_LIKE),
        *("–" if error is None else labels.ratio(labels.over_noise(error, e.noise)) for error in guided),
    )


def _figures(result: Identification, procedure: str) -> list[pages.Figure]:
    """The figures of one procedure."""
    make = FIGURES.get(procedure)
    return [] if make is None else [pages.figure(figure) for figure in make(result.procedures)]


def _static(r: Procedures) -> list[Figure]:
    return [pictures.load_line(r.static_test.line, r.static_test.column)] if r.static_test else []


def _decay(r: Procedures) -> list[Figure]:
    return [pictures.decay(d) for d in r.decays]


def _break_away(r: Procedures) -> list[Figure]:
    # A figure of a single event would be one dot.
    shown = r.static_friction.level and len(r.static_friction.events) > 1
    return [pictures.break_aways(r.static_friction)] if shown else []


def _coulomb(r: Procedures) -> list[Figure]:
    return [
        *([pictures.friction(r.hub_balance)] if r.hub_balance else []),
        *([pictures.friction_map(r.friction_map)] if r.friction_map else []),
    ]


def _spectra(r: Procedures) -> list[Figure]:
    return [
        *([pictures.response(r.response)] if r.response else []),
        *([pictures.backbone(r.backbone)] if r.backbone and len(r.backbone.frequency) > 1 else []),
    ]


def _against(r: Procedures) -> list[Figure]:
    return [pictures.compared_responses(r.comparison)] if r.comparison and r.comparison.responses else []


def _joint(r: Procedures) -> list[Figure]:
    return [pictures.correlation(r.joint)] if len(r.joint.names) > 1 else []


FIGURES: Mapping[str, Callable[[Procedures], list[Figure]]] = {
    "static": _static,
    "decay": _decay,
    "break-away": _break_away,
    "coulomb": _coulomb,
    "spectra": _spectra,
    "against": _against,
    "joint": _joint,
}
"""Name of a procedure -> its figures; a procedure without an entry has none."""
