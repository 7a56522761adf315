"""An identification as one HTML page that needs no network."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from twin import labels
from twin.identification import conclusion, pictures
from twin.identification.held_out import HeldOutError
from twin.identification.procedures import Procedures
from twin.identification.result import Identification
from twin.identification.text import with_half_interval
from twin.report import pages
from twin.report.display import NOISE_LIKE
from twin.report.pages import Cell, Row, Table
from twin.report.prose import prose

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def render(result: Identification) -> str:
    """Returns the page."""
    moves = pictures.moves(result.all_parameters)
    return pages.render(
        "identification/page.html.j2",
        d=result,
        headline=conclusion.headline(result),
        caveat=conclusion.caveat(result),
        moves=None
        if moves is None
        else pages.figure(moves, {"margin": {"l": 118, "r": 8, "t": 40, "b": 46}}),
        parameters=_parameters(result),
        methods=_methods(result),
        held_out=_held_out(result),
        estimated_start=any(e.start == "estimated" for e in result.held_out),
        sections=[(finding, _figures(result, finding.procedure)) for finding in result.findings],
    )


def _parameters(result: Identification) -> Table:
    rows: list[Row] = []
    for name, p in result.all_parameters.items():
        change, reason = conclusion.change(p), result.not_determined.get(name)
        moved = "–" if change is None else labels.signed(change, 1)
        note = prose(f"not determined: {reason}") if reason else ""
        rows.append(
            (
                Cell(labels.parameter(name), note=note),
                labels.number(p.declared, labels.PAGE_DIGITS),
                Cell(with_half_interval(p.estimate), strong=True),
                labels.unit(p.unit),
                Cell(moved, warns=abs(change or 0.0) > conclusion.FAR),
            )
        )
    found = ">best fit" if not result.trust.trusted else ">identified, ± half its 95 % interval"
    return Table(("parameter", ">declared", found, "unit", ">in declared σ"), rows)


def _methods(result: Identification) -> Table:
    """What each procedure finds by itself."""
    rows = [
        (labels.parameter(name), labels.words(method), with_half_interval(e), labels.unit(p.unit))
        for name, p in result.all_parameters.items()
        for method, e in p.methods.items()
        if method != "joint"
    ]
    found = ">by itself" if not result.trust.trusted else ">by itself, ± half its 95 % interval"
    return Table(("parameter", "procedure", found, "unit"), rows)


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
