"""Quantities of the whole rig that follow from the joint estimate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twin.identification.estimates import Estimate
from twin.identification.joint import JointEstimate
from twin.mechanics import beam
from twin.parameters import Rig


@dataclass(frozen=True)
class DerivedQuantity:
    """A derived quantity.

    Attributes:
      label: its name in a sentence, with an article.
      estimate: in `unit`.
      unit: SI.
    """

    label: str
    estimate: Estimate
    unit: str


@dataclass(frozen=True)
class DerivedQuantities:
    """All derived quantities.

    Attributes:
      clamped_frequency: first frequency with the hub clamped.
      free_frequency: first frequency with the hub free.
      total_inertia: of the rigid rig about the hub's axis.
      tip_stiffness: 3 EI/l^3.
    """

    clamped_frequency: DerivedQuantity
    free_frequency: DerivedQuantity
    total_inertia: DerivedQuantity
    tip_stiffness: DerivedQuantity

    def __iter__(self) -> Iterator[DerivedQuantity]:
        yield from (self.clamped_frequency, self.free_frequency, self.total_inertia, self.tip_stiffness)


def derived_quantities(rig: Rig, joint: JointEstimate) -> DerivedQuantities:
    """Returns the derived quantities; `rig` has the parameters that are not estimated."""
    return DerivedQuantities(
        DerivedQuantity(
            "a first frequency, hub clamped",
            joint.derived_estimate(lambda p: _first_hz(beam.modes(p, 1, "clamped")), rig),
            "Hz",
        ),
        DerivedQuantity(
            "a first frequency, hub free",
            joint.derived_estimate(lambda p: _first_hz(beam.modes(p, 1)), rig),
            "Hz",
        ),
        DerivedQuantity("a total inertia", joint.derived_estimate(beam.rigid_inertia, rig), "kg*m^2"),
        DerivedQuantity(
            "a tip stiffness 3 EI/l^3",
            joint.derived_estimate(lambda p: 3 * p["bending_stiffness"] / p["length"] ** 3, rig),
            "N/m",
        ),
    )


def _first_hz(modes: beam.Modes) -> float:
    return float(modes.frequencies[0]) / (2 * np.pi)
