"""Estimates of single parameters by each procedure alone."""

from __future__ import annotations

from twin.identification import balance
from twin.identification.clamped_vibration import (
    declared_estimate,
    free_damping_ratio,
    stiffness_by_frequency,
)
from twin.identification.estimates import Estimate
from twin.identification.joint import with_link_uncertainty
from twin.identification.procedures import Procedures
from twin.parameters import Rig


def estimates_by_procedure(rig: Rig, results: Procedures) -> dict[str, dict[str, Estimate]]:
    """Returns parameter -> procedure -> estimate by that procedure alone; `rig` is the declared one."""
    static, decays, release = results.static_test, results.decays, results.friction_map
    hub = results.hub_balance if results.hub_balance and results.hub_balance.accepted else None
    inertia = with_link_uncertainty(hub.inertia, results.joint) if hub else None
    estimates = {
        ("bending_stiffness", "static"): static.stiffness if static else None,
        ("bending_stiffness", "clamped-frequency"): stiffness_by_frequency(rig, decays) if decays else None,
        ("damping_ratio", "decay"): free_damping_ratio(rig, decays) if decays else None,
        ("static_friction", "break-away"): results.static_friction.level,
        ("coulomb_friction", "hub-balance"): hub.coulomb_mean if hub else None,
        ("coulomb_friction", "decay-map"): release.level if release else None,
        ("hub_inertia", "hub-balance"): inertia if inertia and inertia.informative else None,
        ("tip_mass", "slews"): tip_mass_by_balances(rig, results),
    }
    methods: dict[str, dict[str, Estimate]] = {name: {} for name in results.joint.names}
    for (name, procedure), estimate in estimates.items():
        if estimate is not None and name in methods:
            methods[name][procedure] = estimate
    for name in results.joint.names:
        if name != "static_friction":
            methods[name]["joint"] = results.joint.estimate(name)
    return methods


def tip_mass_by_balances(rig: Rig, results: Procedures) -> Estimate | None:
    """Returns the tip mass by both balances with the link as declared; None where one of them is not accepted."""
    hub, momentum = results.hub_balance, results.momentum
    if hub is None or momentum is None:
        return None
    if not (hub.accepted and momentum.accepted and hub.inertia.informative):
        return None
    link = {name: declared_estimate(rig, name) for name in ("length", "linear_density", "tip_inertia")}
    hub_inertia = with_link_uncertainty(hub.inertia, results.joint)
    return balance.tip_mass_from_inertias(momentum.inertia, hub_inertia, link)
