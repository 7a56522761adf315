"""Bending stiffness and damping ratio from free vibration of the clamped link, with the error of the declared rig."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.identification import joint
from twin.identification.decay import Decay
from twin.identification.estimates import Estimate, pooled
from twin.identification.ring_downs import clamped_ring_downs
from twin.identification.static_test import StaticTest
from twin.mechanics import beam, modal
from twin.parameters import Rig

_BEAM_PARAMETERS = ("linear_density", "length", "tip_mass", "tip_inertia", "hub_inertia")
"""Parameters whose declared uncertainty enters the estimates from clamped vibration."""


def declared_estimate(rig: Rig, name: str) -> Estimate:
    """Returns a declared parameter with its standard deviation."""
    return Estimate(rig[name], joint.prior_deviation(rig, name))


def initial_values(campaign: Campaign, static: StaticTest | None) -> dict[str, float]:
    """Returns stiffness and damping ratio by procedures without simulation, where more accurate than declared."""
    rig, decays = campaign.rig, clamped_ring_downs(campaign.fit)
    candidates = [
        ("bending_stiffness", static.stiffness if static else None),
        ("bending_stiffness", stiffness_by_frequency(rig, decays) if decays else None),
        ("damping_ratio", free_damping_ratio(rig, decays) if decays else None),
    ]
    best: dict[str, Estimate] = {}
    for name, estimate in candidates:
        known = best.get(name, declared_estimate(rig, name))
        if estimate is not None and estimate.standard_error < known.standard_error:
            best[name] = estimate
    return {name: estimate.value for name, estimate in best.items()}


def free_damping_ratio(rig: Rig, decays: tuple[Decay, ...]) -> Estimate:
    """Returns the damping ratio of the free modes by clamped decays, with all losses in the bending of the link.

    The ratio of clamped to free damping depends on the declared masses and lengths, whose uncertainty is included.
    """
    clamped = pooled([d.damping_ratio for d in decays])
    share = _clamped_over_free_damping(rig)
    value = clamped.value / share
    by_rig = value * float(np.linalg.norm(_relative_sensitivities(rig, _clamped_over_free_damping)))
    return Estimate(value, math.hypot(clamped.standard_error / share, by_rig))


def stiffness_by_frequency(rig: Rig, decays: tuple[Decay, ...]) -> Estimate:
    """Returns EI = EI' (f/f')^2 by the first clamped frequency f, with EI' and f' of the declared rig.

    The uncertainty of the declared masses and lengths is included.
    """
    measured = pooled([d.frequency for d in decays])
    value = rig["bending_stiffness"] * (measured.value / _first_clamped_frequency(rig)) ** 2
    by_rig = [2 * s for s in _relative_sensitivities(rig, _first_clamped_frequency)]
    relative = [2 * measured.standard_error / measured.value, *by_rig]
    return Estimate(value, value * float(np.linalg.norm(relative)))


def _relative_sensitivities(rig: Rig, quantity: Callable[[Rig], float]) -> list[float]:
    """Relative change of a quantity by one standard deviation of each declared mass and length."""
    changes = []
    for name in _BEAM_PARAMETERS:
        sigma = joint.prior_deviation(rig, name)
        if sigma > 0:
            changed = quantity(rig.replace("perturbed", **{name: rig[name] + 0.1 * sigma}))
            changes.append((changed / quantity(rig) - 1) / 0.1)
    return changes


def _clamped_over_free_damping(rig: Rig) -> float:
    """Damping ratio of the first clamped mode over that of the free modes [1]; it does not depend on the losses."""
    return float(modal.clamped_damping_ratios(rig.replace(damping_ratio=0.01), 1)[0]) / 0.01


def _first_clamped_frequency(rig: Rig) -> float:
    """First natural frequency with the hub clamped [Hz]."""
    return float(beam.modes(rig, 1, "clamped").frequencies[0]) / (2 * np.pi)
