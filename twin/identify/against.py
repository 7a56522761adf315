"""Peaks of one rig beside those of the same rig with another load: which move as bending modes do.

A payload moves each bending mode by as much as the beam says; an air-pad leaves them alone. A peak that stays where
they move, or that moves or vanishes where they stay, is none (mass loading; Bossi et al. 2009, Fig. 4: a peak near
28 Hz almost vanishes with the air-pad).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from twin import beam
from twin.campaign import Campaign
from twin.chain import SHAPED_BY
from twin.identify import spectra
from twin.identify.results import Kind
from twin.identify.spectra import Peak, Response
from twin.parameters import Rig

_MODES = 5
_SURE = 3.0  # standard errors of a frequency that count as the same
_SOFTER = 0.02  # relative change of a frequency by another amplitude
_GONE = 1 / 3  # of the height of a peak, below which it has vanished


@dataclass(frozen=True)
class PairedPeak:
    """A peak of one campaign and what became of it in the other.

    Attributes:
      frequency_hz: of the peak [Hz].
      other_hz: where it is in the other campaign [Hz]; None where it is gone.
      bending_hz: where a bending mode would be [Hz].
      height: response there over that of the peak [1].
      kind: "bending" where it moved, or stayed, as one.
    """

    frequency_hz: float
    other_hz: float | None
    bending_hz: float
    height: float
    kind: Kind


@dataclass(frozen=True)
class Comparison:
    """Two campaigns of one rig.

    Attributes:
      campaign: the other one.
      changed: parameter of the link and its ends -> declared here and there, where they differ.
      peaks: of the first campaign, as far as the other one excites them.
      appeared: those of the other campaign of which nothing is in the first.
      missing: what the recordings lack; None where there is a comparison.
      responses: here and there; none where something is missing.
    """

    campaign: str
    changed: dict[str, tuple[float, float]]
    peaks: tuple[PairedPeak, ...]
    appeared: tuple[PairedPeak, ...] = ()
    missing: str | None = None
    responses: tuple[Response, ...] = field(default=(), repr=False)

    def to_json(self) -> dict[str, Any]:
        """The comparison as plain values."""
        return {
            "campaign": self.campaign,
            "changed": {name: list(values) for name, values in self.changed.items()},
            "peaks": [asdict(peak) for peak in self.peaks],
            "appeared": [asdict(peak) for peak in self.appeared],
            "missing": self.missing,
        }


def compare(campaign: Campaign, other: Campaign) -> Comparison:
    """Compares the peaks of two campaigns in the channel that shows those of the first."""
    here = spectra.response(campaign.fit)
    there = None
    if here is not None:
        there = spectra.response([r for r in other.fit if here.channel in r], here.channel)
    changed = {
        name: (value, other.rig[name])
        for name in SHAPED_BY
        if not math.isclose(value := campaign.rig[name], other.rig[name], rel_tol=1e-9)
    }
    if here is None or there is None:
        lacking = campaign.name if here is None else other.name
        missing = f"no recording of {lacking} from rest whose torque excites a broad band"
        return Comparison(other.name, changed, (), missing=missing)
    peaks = paired(here, campaign.rig, there, other.rig)
    back = paired(there, other.rig, here, campaign.rig)
    appeared = tuple(p for p in back if p.other_hz is None)
    return Comparison(other.name, changed, peaks, appeared, responses=(here, there))


def paired(here: Response, rig: Rig, there: Response, other: Rig) -> tuple[PairedPeak, ...]:
    """The peaks of one response beside those of another, whose rigs are declared as such."""
    modes, moved = (beam.modes(r, _MODES).frequencies / (2 * math.pi) for r in (rig, other))
    candidates = spectra.peaks(there)
    excited = there.frequency[there.known]
    found = []
    for peak in spectra.peaks(here):
        mode = int(np.argmin(np.abs(np.log(modes / peak.frequency.value))))
        expected = peak.frequency.value * float(moved[mode] / modes[mode])
        if excited.size and excited[0] < min(expected, peak.frequency.value) and excited[-1] > expected:
            found.append(_pair(peak, expected, candidates, there))
    return tuple(found)


def _pair(peak: Peak, expected: float, candidates: Sequence[Peak], there: Response) -> PairedPeak:
    f = peak.frequency.value
    as_bending = _near(peak, expected, candidates)
    stayed = _near(peak, f, candidates)
    height = as_bending.height / peak.height if as_bending else _left(peak, expected, there)
    if as_bending is not None and height > _GONE:
        return PairedPeak(f, as_bending.frequency.value, expected, height, "bending")
    if stayed is not None and stayed.height > _GONE * peak.height:
        return PairedPeak(f, stayed.frequency.value, expected, stayed.height / peak.height, "not bending")
    return PairedPeak(f, None, expected, height, "not bending")


def _near(peak: Peak, frequency: float, candidates: Sequence[Peak]) -> Peak | None:
    """The candidate at a frequency [Hz] as far as its error, the peak's own and the amplitude leave it open."""
    near = [c for c in candidates if abs(c.frequency.value / frequency - 1) < _open(peak, c)]
    return min(near, key=lambda c: abs(c.frequency.value - frequency), default=None)


def _open(a: Peak, b: Peak) -> float:
    relative = [p.frequency.standard_error / p.frequency.value for p in (a, b)]
    return _SURE * math.hypot(*relative) + _SOFTER


def _left(peak: Peak, frequency: float, there: Response) -> float:
    """Response about a frequency [Hz] over the height of the peak [1]."""
    near = np.abs(there.frequency / frequency - 1) < _SOFTER
    return float(np.abs(there.h1[near]).max() / peak.height) if near.any() else math.nan
