"""Identification of a rig: the procedures of Bossi et al. 2009, and one joint estimate that they start."""

from __future__ import annotations

import time
from collections.abc import Sequence

from threadpoolctl import threadpool_limits

from twin.campaigns.campaign import Campaign
from twin.estimation.residual_pool import ResidualPool
from twin.identification import findings
from twin.identification.clamped_vibration import declared_estimate
from twin.identification.derived import DerivedQuantities, derived_quantities
from twin.identification.estimates import Finding, Mode
from twin.identification.held_out import HeldOutError, held_out_errors
from twin.identification.identified_parameters import identified_parameters, not_determined
from twin.identification.joint_finding import joint_finding
from twin.identification.modes import clamped_mode, free_modes
from twin.identification.parameter_estimates import tip_mass_by_balances
from twin.identification.procedures import Procedures, run_procedures
from twin.identification.result import Identification
from twin.identification.trust import derived_without_intervals, trust_in, without_intervals
from twin.parameters import Rig
from twin.progress import Progress, silent


def identify(
    campaign: Campaign, progress: Progress = silent, workers: int = 1, other: Campaign | None = None
) -> Identification:
    """Identifies a rig from the fit recordings of a campaign, and predicts the held-out ones.

    Args:
      campaign: the recordings.
      progress: called with a text at every stage.
      workers: number of threads, and of processes that compute residuals.
      other: campaign of the same rig with another payload or with an air-pad, to classify the resonances.
    """
    began = time.perf_counter()
    results = run_procedures(campaign, other, progress, workers)
    identified = identified_parameters(campaign, results)
    values = {name: p.value for name, p in identified.items() if name in campaign.rig}
    rig = campaign.rig.replace("identified", **values)
    progress("predicting the held-out recordings")
    with threadpool_limits(1), ResidualPool(workers) as pool:
        held_out, left_out = held_out_errors(campaign, results.joint, rig, pool)
    modes = free_modes(results.joint.fit.model.declared, results.response)
    derived = derived_quantities(campaign.rig, results.joint)
    undetermined = not_determined(identified, results.joint)
    trust = trust_in(results.joint, held_out)
    found = _findings(campaign.rig, results, modes, derived, held_out, trust.trusted)
    if not trust.trusted:
        identified = {name: without_intervals(p) for name, p in identified.items()}
        derived = derived_without_intervals(derived)
    return Identification(
        campaign=campaign.name,
        rig=campaign.rig,
        procedures=results,
        identified=identified,
        not_determined=undetermined,
        modes=(*(clamped_mode(d) for d in results.decays), *modes),
        derived=derived,
        findings=found,
        held_out=held_out,
        trust=trust,
        notes=(*campaign.warnings, *results.joint.notes, *left_out),
        wall_s=time.perf_counter() - began,
    )


def _findings(
    rig: Rig,
    results: Procedures,
    modes: Sequence[Mode],
    derived: DerivedQuantities,
    held_out: Sequence[HeldOutError],
    trusted: bool,
) -> tuple[Finding, ...]:
    """The result of each procedure in sentences; `rig` is the declared one, `modes` are those with a free hub."""
    r, joint = results, results.joint
    total, frequency = derived.total_inertia.estimate, derived.free_frequency.estimate
    tip_mass = tip_mass_by_balances(rig, results)
    return (
        findings.static(r.static_test, declared_estimate(rig, "bending_stiffness")),
        findings.decays(r.decays),
        findings.break_aways(r.static_friction),
        findings.coulomb(r.hub_balance, r.friction_map, joint, r.static_friction.level),
        findings.inertia(r.hub_balance, r.momentum, total, tip_mass, joint),
        findings.spectra(r.response, modes, r.backbone, frequency),
        *([findings.campaigns_compared(r.comparison)] if r.comparison is not None else []),
        joint_finding(joint, derived, held_out, trusted),
    )
