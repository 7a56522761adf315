"""Modes of vibration: of the clamped link by its decays, of the free rig by the peaks of its frequency response."""

from __future__ import annotations

from dataclasses import replace

from twin.identification import backbone, spectra
from twin.identification.bending_modes import SOFTENING_TOLERANCE, bending_frequencies, is_near_bending_mode
from twin.identification.decay import Decay
from twin.identification.estimates import Kind, Mode
from twin.identification.spectra import Response
from twin.parameters import Rig


def clamped_mode(decay: Decay) -> Mode:
    """Returns the mode that a ring-down shows."""
    source = f"{decay.recording}, {decay.channel}"
    return Mode("clamped", decay.frequency, decay.damping_ratio, "bending", source)


def free_modes(rig: Rig, response: Response | None) -> tuple[Mode, ...]:
    """Returns the resonances with a free hub; those at a bending mode of the identified rig are bending modes."""
    if response is None:
        return ()
    first_bending = float(bending_frequencies(rig, 1)[0])
    source = f"{', '.join(response.recordings)}, {response.channel}"
    modes = []
    for peak in spectra.peaks(response):
        kind: Kind = "bending" if is_near_bending_mode(peak.frequency.value, rig) else "not bending"
        modes.append(Mode("free", peak.frequency, peak.damping_ratio, kind, source))
    first = backbone.resonance(response, first_bending)
    if first is None or any(abs(m.frequency.value / first_bending - 1) <= SOFTENING_TOLERANCE for m in modes):
        return tuple(modes)
    if any(m.frequency == first for m in modes):  # a linear mode that lies far from where it was declared
        return tuple(replace(m, kind="bending") if m.frequency == first else m for m in modes)
    # Friction and large bends deform the first peak so far that no linear mode fits: its maximum is used.
    return (Mode("free", first, None, "bending", source), *modes)
