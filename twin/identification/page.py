"""An identification on one HTML page that needs no network."""

from __future__ import annotations

from twin.identification import pictures
from twin.identification.estimates import Finding
from twin.identification.findings import shown
from twin.identification.identify import Identification
from twin.report import pages


def render(found: Identification) -> str:
    """Returns the page."""
    procedures = [(finding, _pictures(found, finding)) for finding in found.findings]
    return pages.render("identification/page.html.j2", d=found, shown=shown, procedures=procedures)


def _pictures(found: Identification, finding: Finding) -> list[str]:
    """The figures of one procedure as HTML."""
    figures = {
        "static": lambda: [pictures.load_line(found.load.line, found.load.column)] if found.load else [],
        "decay": lambda: [pictures.decay(d) for d in found.decays],
        "break-away": lambda: (
            [pictures.break_aways(found.static_friction)] if found.static_friction.level else []
        ),
        "coulomb": lambda: [
            *([pictures.friction(found.hub)] if found.hub else []),
            *([pictures.friction_map(found.released)] if found.released else []),
        ],
        "spectra": lambda: [
            *([pictures.response(found.spectrum)] if found.spectrum else []),
            *([pictures.backbone(found.moved)] if found.moved else []),
        ],
        "against": lambda: (
            [pictures.beside(found.compared)] if found.compared and found.compared.responses else []
        ),
        "joint": lambda: [pictures.correlation(found.joint)],
    }
    made = figures.get(finding.procedure, list)()
    return [pages.figure_html(figure, f"{finding.procedure}-{k}") for k, figure in enumerate(made)]
