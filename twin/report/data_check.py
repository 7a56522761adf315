"""What the data of a campaign allow, before anything is fitted: findings, visible effects, expected time; as page."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from twin import labels
from twin.campaigns.campaign import Campaign
from twin.diagnosis.detectable import Detectable, detectable
from twin.estimation.residual_pool import ResidualPool
from twin.files.provenance import Provenance
from twin.files.whole import write_file
from twin.progress import Progress, silent
from twin.proposal import gate
from twin.proposal.gate import Finding
from twin.report import data_figures, pages
from twin.report.data_figures import ReadRecording
from twin.report.pages import Cell, Row, Table
from twin.report.prose import prose

_ROUND = 5.0, 60.0
"""Time of a diagnosis over that of the visible effects [1]: nothing missing, two effects of a bench with rough sensors.
With one it took 11 times as long on the bundled campaign, with those two 51 times on three recordings of virtual bench
101 (by hand)."""


FOUND = "found from"
"""Heading of the column of the changes that are found."""
EXPLANATION = (
    "By how much each parameter has to differ from the value at which its effect does nothing. Standard error: how "
    "well the recordings determine it, all declared parameters being fitted beside it. Found from: the smallest "
    "difference for which a diagnosis would adopt the effect. It is a value with 'or less' where the effect does "
    "nothing at an infinite value, as the stiffness of a rigid clamp, and 'not seen' where these recordings show the "
    "effect at no value in the range of the parameter, so that it takes other ones. Both suppose that the declared "
    "model is right but for the effect, and that its trace is proportional to its size: a dead zone or a play can show "
    "earlier."
)
"""What the numbers of the visible effects mean."""


@dataclass(frozen=True)
class DataCheck:
    """The data of a campaign as they are before a fit.

    Attributes:
      campaign: its name.
      findings: what was looked at.
      visible: what the fit recordings can show of each effect.
      seconds: least and most time that a diagnosis is expected to take on this machine [s].
      provenance: what it was computed with and from, or None if that was not recorded.
      recordings: what the page draws.
    """

    campaign: str
    findings: tuple[Finding, ...]
    visible: tuple[Detectable, ...]
    seconds: tuple[float, float]
    provenance: Provenance | None = None
    recordings: tuple[ReadRecording, ...] = field(default=(), repr=False)

    @property
    def failures(self) -> tuple[Finding, ...]:
        """What would mislead a fit."""
        return tuple(f for f in self.findings if f.fails)

    @property
    def passed(self) -> bool:
        """Whether nothing would mislead a fit, and any effect shows."""
        return not self.failures and any(d.is_visible for d in self.visible)

    def to_json(self) -> dict[str, object]:
        """Returns it as plain values."""
        return {
            "campaign": self.campaign,
            "passed": self.passed,
            "findings": [f.to_json() for f in self.findings],
            "visible": [d.to_json() for d in self.visible],
            "diagnosis_seconds": list(self.seconds),
            "provenance": None if self.provenance is None else self.provenance.to_json(),
        }


def check_data(campaign: Campaign, progress: Progress = silent) -> DataCheck:
    """Looks at the data of a campaign.

    Raises:
      InputError: the declared link diverges under the measured motion of the hub in every recording.
    """
    progress("looking at the recordings")
    findings = tuple(gate.look(campaign))
    with ResidualPool(os.cpu_count() or 1) as pool:
        began = time.perf_counter()
        visible = detectable(campaign, pool, progress)
        took = time.perf_counter() - began
    low, high = _ROUND
    recordings = data_figures.read_recordings(campaign)
    return DataCheck(campaign.name, findings, visible, (low * took, high * took), recordings=recordings)


def headline(check: DataCheck) -> str:
    """Returns whether a fit can begin, in a sentence."""
    if check.failures:
        wrong = labels.join_with_and([f.what for f in check.failures])
        return f"{check.campaign} does not pass: a fit would be misled ({wrong})."
    if not check.passed:
        return f"{check.campaign} does not pass: its recordings show no effect of the library at any size."
    oddities = sum(not f.ok for f in check.findings)
    noted = {0: "nothing would mislead a fit", 1: "one thing limits what can be found"}
    return f"{check.campaign} passes: {noted.get(oddities, f'{oddities} things limit what can be found')}."


def rows(check: DataCheck) -> Iterator[tuple[str, str, str]]:
    """Yields mark, what was looked at, and what was found."""
    for finding in check.findings:
        yield ("ok" if finding.ok else "FAIL" if finding.fails else "WARN"), finding.what, prose(finding.text)


def visible_rows(check: DataCheck) -> Iterator[tuple[str, str, str, str]]:
    """Yields effect, parameter, standard error of a change from neutral, and the change from which it is found."""
    for before, d in zip((None, *check.visible), check.visible, strict=False):
        effect = "" if before is not None and before.effect == d.effect else labels.words(d.effect)
        sigma = _with_unit(d.sigma, d) if math.isfinite(d.sigma) and d.is_visible else "–"
        yield effect, labels.words(d.parameter), sigma, _found(d)


def _found(d: Detectable) -> str:
    """The change from neutral from which a parameter is found."""
    if not d.is_visible:
        return "not seen"
    if math.isfinite(d.neutral):
        return _with_unit(abs(d.found - d.neutral), d)
    return f"{_with_unit(d.found, d)} or less"


def _with_unit(value: float, d: Detectable) -> str:
    return f"{labels.number(value, 2)} {labels.unit(d.unit)}".strip()


def expected(check: DataCheck) -> str:
    """Returns how long a diagnosis is expected to take."""
    low, high = (labels.duration(seconds) for seconds in check.seconds)
    return f"A diagnosis is expected to take {low} to {high} on this machine."


def write_page(check: DataCheck, path: Path) -> None:
    """Writes one HTML file; it is overwritten.

    Raises:
      InputError: the file cannot be written.
    """
    write_file(path, render(check))


def render(check: DataCheck) -> str:
    """Returns the page."""
    return pages.render(
        "report/data.html.j2",
        name=check.campaign,
        headline=headline(check),
        expected=expected(check),
        findings=_findings(check),
        visible=_visible(check),
        provenance=check.provenance,
        explanation=EXPLANATION,
        recordings=list(data_figures.shown(check.recordings)),
    )


def _findings(check: DataCheck) -> Table:
    table: list[Row] = [(what, Cell(mark, warns=mark != "ok"), text) for mark, what, text in rows(check)]
    return Table(("looked at", "result", "found"), table)


def _visible(check: DataCheck) -> Table:
    """A row for each parameter, below the name of its effect."""
    found = list(visible_rows(check))
    groups = {k: effect for k, (effect, *_) in enumerate(found) if effect}
    return Table(("parameter", ">standard error", f">{FOUND}"), [row[1:] for row in found], groups)
