"""An identification as one HTML page that needs no network."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from twin.identification import pictures
from twin.identification.procedures import Procedures
from twin.identification.result import Identification
from twin.identification.text import format_estimate
from twin.report import pages

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def render(result: Identification) -> str:
    """Returns the page."""
    sections = [(finding, _figures(result, finding.procedure)) for finding in result.findings]
    return pages.render(
        "identification/page.html.j2", d=result, format_estimate=format_estimate, sections=sections
    )


def _figures(result: Identification, procedure: str) -> list[str]:
    """The figures of one procedure as HTML."""
    make = FIGURES.get(procedure)
    figures = [] if make is None else make(result.procedures)
    return [pages.figure_html(figure, f"{procedure}-{k}") for k, figure in enumerate(figures)]


def _static(r: Procedures) -> list[Figure]:
    return [pictures.load_line(r.static_test.line, r.static_test.column)] if r.static_test else []


def _decay(r: Procedures) -> list[Figure]:
    return [pictures.decay(d) for d in r.decays]


def _break_away(r: Procedures) -> list[Figure]:
    return [pictures.break_aways(r.static_friction)] if r.static_friction.level else []


def _coulomb(r: Procedures) -> list[Figure]:
    return [
        *([pictures.friction(r.hub_balance)] if r.hub_balance else []),
        *([pictures.friction_map(r.friction_map)] if r.friction_map else []),
    ]


def _spectra(r: Procedures) -> list[Figure]:
    return [
        *([pictures.response(r.response)] if r.response else []),
        *([pictures.backbone(r.backbone)] if r.backbone else []),
    ]


def _against(r: Procedures) -> list[Figure]:
    return [pictures.compared_responses(r.comparison)] if r.comparison and r.comparison.responses else []


def _joint(r: Procedures) -> list[Figure]:
    return [pictures.correlation(r.joint)]


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
