"""Peaks of one rig beside those of the same rig with another load: which move as bending modes do.

A payload moves each bending mode by as much as the beam says; an air-pad leaves them alone. A peak that stays where
they move, or that moves or vanishes where they stay, is none (mass loading; Bossi et al. 2009, Fig. 4: a peak near
28 Hz almost vanishes with the air-pad).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.identification import near_modes, spectra
from twin.identification.estimates import Kind
from twin.identification.spectra import Peak, Response
from twin.mechanics.chain import SHAPE_PARAMETERS
from twin.parameters import Rig

_BENDING: Kind = "bending"
_NOT_BENDING: Kind = "not bending"
_MODES = 5
_SURE = 3.0  # standard errors of a frequency that count as the same
_SOFTER = 0.02  # relative change of a frequency by another amplitude
_GONE = 1 / 3  # of the height of a peak, below which it has vanished


@dataclass(frozen=True)
class PairedPeak:
    """A peak of one campaign and what became of it in the other.

    Attributes:
      frequency_hz: of the peak [Hz].
      other_hz: where it is in the other campaign [Hz]; None where there is no clear peak.
      bending_hz: where a bending mode would be [Hz].
      height: response there over that of the peak [1]; without a clear peak the larger of those here and there.
      kind: "bending" where it moved, or stayed, as one; "unknown" where no clear peak is left, but much of its height.
    """

    frequency_hz: float
    other_hz: float | None
    bending_hz: float
    height: float
    kind: Kind

    @property
    def gone(self) -> bool:
        """Whether hardly anything of it is left."""
        return self.other_hz is None and self.height < _GONE


@dataclass(frozen=True)
class Comparison:
    """Two campaigns of one rig.

    Attributes:
      campaign: the other one.
      changed: parameter of the link and its ends -> declared here and there, where they differ.
      peaks: of the first campaign, as far as the other one excites them.
      appeared: clear peaks of the other campaign that are none in the first; of bending where its rig has such a mode.
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


def compare(campaign: Campaign, other: Campaign, rig: Rig | None = None) -> Comparison:
    """Compares the peaks of two campaigns in the channel that shows those of the first.

    Args:
      campaign, other: of one rig, each with what it declares of it.
      rig: as identified from the first; in the other it differs by what the two declare.
    """
    here = spectra.response(campaign.fit)
    there = None
    if here is not None:
        there = spectra.response([r for r in other.fit if here.channel in r], here.channel)
    changed = {
        name: (value, other.rig[name])
        for name in SHAPE_PARAMETERS
        if not math.isclose(value := campaign.rig[name], other.rig[name], rel_tol=1e-9)
    }
    if here is None or there is None:
        lacking = campaign.name if here is None else other.name
        missing = f"no recording of {lacking} from rest whose torque excites a broad band"
        return Comparison(other.name, changed, (), missing=missing)
    rig = rig or campaign.rig
    loaded = rig.replace("loaded", **{name: value for name, (_, value) in changed.items()})
    peaks = paired(here, rig, there, loaded)
    back = paired(there, loaded, here, rig)
    appeared = tuple(_appeared(p, loaded) for p in back if p.other_hz is None)
    return Comparison(other.name, changed, peaks, appeared, responses=(here, there))


def paired(here: Response, rig: Rig, there: Response, other: Rig) -> tuple[PairedPeak, ...]:
    """The peaks of one response beside those of another, whose rigs are declared as such."""
    modes, moved = (near_modes.bending_frequencies(r, _MODES) for r in (rig, other))
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
    for found, kind in ((as_bending, _BENDING), (stayed, _NOT_BENDING)):
        if found is not None and found.height > _GONE * peak.height:
            return PairedPeak(f, found.frequency.value, expected, found.height / peak.height, kind)
    height = max(_left(peak, expected, there), _left(peak, f, there))
    return PairedPeak(f, None, expected, height, _NOT_BENDING if height < _GONE else "unknown")


def _appeared(peak: PairedPeak, rig: Rig) -> PairedPeak:
    """A peak that is clear in one campaign only: its place says whether it is of bending, as it does of any peak."""
    return replace(peak, kind=_BENDING) if near_modes.near_bending(peak.frequency_hz, rig) else peak


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
    return float(np.abs(there.h1[near]).max() / peak.height) if near.any() else 0.0
