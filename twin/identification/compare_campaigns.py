"""Resonances of one rig with two different loads: which of them shift as bending modes do.

A payload shifts each bending mode by the amount that the beam model predicts; an air-pad does not shift them. A peak
that stays where bending modes shift, or that shifts or vanishes where they stay, is no bending mode (mass loading;
Bossi et al. 2009, Fig. 4: a peak near 28 Hz almost vanishes with the air-pad).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.identification import bending_modes, spectra
from twin.identification.estimates import Kind
from twin.identification.spectra import Peak, Response
from twin.mechanics.chain import SHAPE_PARAMETERS
from twin.parameters import Rig

_BENDING: Kind = "bending"
_NOT_BENDING: Kind = "not bending"
_MODES = 5  # bending modes among which that of a peak is looked up
_FREQUENCY_TOLERANCE = 3.0  # standard errors within which two frequencies are equal
_AMPLITUDE_TOLERANCE = 0.02  # relative change of a frequency that another vibration amplitude may cause [1]
_VANISHED_HEIGHT = 1 / 3  # share of the height of a peak below which it has vanished [1]


@dataclass(frozen=True)
class PairedPeak:
    """A peak of one campaign and its counterpart in the other.

    Attributes:
      frequency_hz: in the first campaign [Hz].
      other_hz: in the other campaign [Hz]; None where it has no peak there.
      bending_hz: where the peak would be in the other campaign if it were a bending mode [Hz].
      height: height in the other campaign over that in the first [1]; without a peak the larger response at
        `frequency_hz` and at `bending_hz`.
      kind: "bending" where the peak shifted as a bending mode; "unknown" without a peak but with much of its height.
    """

    frequency_hz: float
    other_hz: float | None
    bending_hz: float
    height: float
    kind: Kind

    @property
    def vanished(self) -> bool:
        """Whether the peak has vanished in the other campaign."""
        return self.other_hz is None and self.height < _VANISHED_HEIGHT


@dataclass(frozen=True)
class Comparison:
    """Resonances of two campaigns of one rig.

    Attributes:
      campaign: name of the other campaign.
      changed: parameter of the beam model -> declared value in both campaigns, where they differ.
      peaks: of the first campaign, as far as the other one excites their frequencies.
      appeared: peaks of the other campaign without counterpart in the first.
      missing: which recordings are lacking; None where there is a comparison.
      responses: frequency responses of both campaigns; empty where recordings are lacking.
    """

    campaign: str
    changed: dict[str, tuple[float, float]]
    peaks: tuple[PairedPeak, ...]
    appeared: tuple[PairedPeak, ...] = ()
    missing: str | None = None
    responses: tuple[Response, ...] = field(default=(), repr=False)

    def to_json(self) -> dict[str, Any]:
        """Returns the comparison as plain values for JSON."""
        return {
            "campaign": self.campaign,
            "changed": {name: list(values) for name, values in self.changed.items()},
            "peaks": [asdict(peak) for peak in self.peaks],
            "appeared": [asdict(peak) for peak in self.appeared],
            "missing": self.missing,
        }


def compare(campaign: Campaign, other: Campaign, rig: Rig | None = None) -> Comparison:
    """Compares the resonances of two campaigns in the response channel of the first.

    Args:
      campaign, other: of one rig; each declares its own parameters.
      rig: as identified from the first campaign, by default as declared; the rig of the other campaign differs from it
        by the difference of the declarations.
    """
    here = spectra.frequency_response(campaign.fit)
    there = None
    if here is not None:
        there = spectra.frequency_response([r for r in other.fit if here.channel in r], here.channel)
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
    peaks = pair_peaks(here, rig, there, loaded)
    back = pair_peaks(there, loaded, here, rig)
    appeared = tuple(_classify_unpaired(p, loaded) for p in back if p.other_hz is None)
    return Comparison(other.name, changed, peaks, appeared, responses=(here, there))


def pair_peaks(here: Response, rig: Rig, there: Response, other: Rig) -> tuple[PairedPeak, ...]:
    """Returns the peaks of one response with their counterparts in another.

    Args:
      here, there: the two responses.
      rig, other: the rigs that they belong to.
    """
    modes, shifted = (bending_modes.bending_frequencies(r, _MODES) for r in (rig, other))
    candidates = spectra.peaks(there)
    excited = there.frequency[there.known]
    pairs = []
    for peak in spectra.peaks(here):
        mode = int(np.argmin(np.abs(np.log(modes / peak.frequency.value))))
        expected = peak.frequency.value * float(shifted[mode] / modes[mode])
        if excited.size and excited[0] < min(expected, peak.frequency.value) and excited[-1] > expected:
            pairs.append(_pair_peak(peak, expected, candidates, there))
    return tuple(pairs)


def _pair_peak(peak: Peak, expected: float, candidates: Sequence[Peak], there: Response) -> PairedPeak:
    """The counterpart of a peak: a candidate where a bending mode is expected [Hz], else one at its own frequency."""
    f = peak.frequency.value
    as_bending = _nearest_candidate(peak, expected, candidates)
    unshifted = _nearest_candidate(peak, f, candidates)
    for other, kind in ((as_bending, _BENDING), (unshifted, _NOT_BENDING)):
        if other is not None and other.height > _VANISHED_HEIGHT * peak.height:
            return PairedPeak(f, other.frequency.value, expected, other.height / peak.height, kind)
    height = max(_relative_response(peak, expected, there), _relative_response(peak, f, there))
    return PairedPeak(f, None, expected, height, _NOT_BENDING if height < _VANISHED_HEIGHT else "unknown")


def _classify_unpaired(peak: PairedPeak, rig: Rig) -> PairedPeak:
    """A peak without counterpart; it is a bending mode if it lies at one of the rig."""
    return (
        replace(peak, kind=_BENDING) if bending_modes.is_near_bending_mode(peak.frequency_hz, rig) else peak
    )


def _nearest_candidate(peak: Peak, frequency: float, candidates: Sequence[Peak]) -> Peak | None:
    """The candidate nearest to a frequency [Hz], within the tolerance of both peaks; None without one."""
    near = [c for c in candidates if abs(c.frequency.value / frequency - 1) < _relative_tolerance(peak, c)]
    return min(near, key=lambda c: abs(c.frequency.value - frequency), default=None)


def _relative_tolerance(a: Peak, b: Peak) -> float:
    """Relative difference [1] within which the frequencies of two peaks are equal."""
    relative = [p.frequency.standard_error / p.frequency.value for p in (a, b)]
    return _FREQUENCY_TOLERANCE * math.hypot(*relative) + _AMPLITUDE_TOLERANCE


def _relative_response(peak: Peak, frequency: float, there: Response) -> float:
    """Largest response about a frequency [Hz] over the height of the peak [1]."""
    near = np.abs(there.frequency / frequency - 1) < _AMPLITUDE_TOLERANCE
    return float(np.abs(there.h1[near]).max() / peak.height) if near.any() else 0.0
