"""All identification procedures on one campaign, in the order in which they need one another."""

from __future__ import annotations

from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from twin.campaigns.campaign import Campaign
from twin.estimation.residual_pool import ResidualPool
from twin.identification import (
    backbone,
    balance,
    break_away,
    compare_campaigns,
    friction_map,
    spectra,
    static_test,
    total_inertia,
)
from twin.identification.backbone import Backbone
from twin.identification.balance import Balance
from twin.identification.bending_modes import bending_frequencies
from twin.identification.break_away import StaticFriction
from twin.identification.clamped_vibration import initial_values
from twin.identification.compare_campaigns import Comparison
from twin.identification.decay import Decay
from twin.identification.friction_map import FrictionMap
from twin.identification.joint import JointEstimate, joint_estimate
from twin.identification.nuisance import perturbed_models, with_nuisance_errors
from twin.identification.ring_downs import clamped_ring_downs, ring_downs_at_rest
from twin.identification.spectra import Response
from twin.identification.static_test import StaticTest
from twin.identification.total_inertia import MomentumBalance
from twin.progress import Progress
from twin.residuals.prepared import sensor_corrected_start
from twin.rigs.model import Model, with_fine_chain
from twin.rigs.simulate import simulate


@dataclass(frozen=True)
class Procedures:
    """Results of all procedures; None where the recordings do not allow one.

    Attributes:
      static_test: bending stiffness by static loads.
      joint: joint estimate of all declared parameters.
      decays: ring-downs of the clamped link.
      static_friction: levels at break-aways.
      hub_balance: torque balance of the hub.
      momentum: balance of the whole rig's angular momentum.
      friction_map: Coulomb friction by the decay of the unclamped link.
      response: frequency response of the link to the torque.
      backbone: frequency of the first resonance by amplitude.
      comparison: resonances beside those of another campaign; None where none was given.
    """

    static_test: StaticTest | None
    joint: JointEstimate
    decays: tuple[Decay, ...]
    static_friction: StaticFriction
    hub_balance: Balance | None
    momentum: MomentumBalance | None
    friction_map: FrictionMap | None
    response: Response | None
    backbone: Backbone | None
    comparison: Comparison | None


def run_procedures(
    campaign: Campaign, other: Campaign | None, progress: Progress, workers: int
) -> Procedures:
    """Runs all procedures on the fit recordings of a campaign.

    Args:
      campaign: the recordings.
      other: campaign of the same rig with another load; None for no comparison.
      progress: called with a text at every stage.
      workers: number of threads, and of processes that compute residuals.
    """
    static = static_test.evaluate(campaign)
    with threadpool_limits(1), ResidualPool(workers) as pool:
        joint = joint_estimate(campaign, pool, progress, initial_values(campaign, static))
        progress("reading decays and break-aways")
        decays = clamped_ring_downs(joint.readings) or ring_downs_at_rest(joint.prepared)
        friction = break_away.static_friction(joint.data, joint.fit.model, joint.fit.starts)
        progress("balancing torques")
        hub_balance = _hub_balance(joint)
        momentum = _momentum_balance(joint)
        # Break-aways give the static friction that simulations need.
        model = _with_static_friction(with_fine_chain(joint.fit.model), friction)
        release = _friction_map(joint, model)
    return Procedures(
        static_test=static,
        joint=joint,
        decays=decays,
        static_friction=friction,
        hub_balance=hub_balance,
        momentum=momentum,
        friction_map=release,
        response=spectra.frequency_response(joint.readings),
        backbone=_backbone(joint, model),
        comparison=_comparison(campaign, other, joint),
    )


def _hub_balance(joint: JointEstimate) -> Balance | None:
    model, starts = joint.fit.model, joint.fit.starts
    return with_nuisance_errors(
        lambda m: balance.hub_balance(joint.data, m, starts),
        balance.with_balance_nuisance_error,
        model,
        perturbed_models(joint, model),
    )


def _momentum_balance(joint: JointEstimate) -> MomentumBalance | None:
    model = joint.fit.model
    # Internal losses of the link do not change the angular momentum of the rig.
    return with_nuisance_errors(
        lambda m: total_inertia.momentum_balance(joint.data, m),
        total_inertia.with_momentum_nuisance_error,
        model,
        perturbed_models(joint, model, link_damping=False),
    )


def _friction_map(joint: JointEstimate, model: Model) -> FrictionMap | None:
    return with_nuisance_errors(
        lambda m: friction_map.friction_map_of_release(m, joint.prepared, joint.fit.starts),
        friction_map.with_map_nuisance_error,
        model,
        perturbed_models(joint, model),
    )


def _with_static_friction(model: Model, friction: StaticFriction) -> Model:
    """The model with the static friction by break-aways, where there are any."""
    if friction.level is None:
        return model
    return model.replace(declared=model.declared.replace("read", static_friction=friction.level.value))


def _backbone(joint: JointEstimate, model: Model) -> Backbone | None:
    """The backbone of the first resonance, measured and as the model simulates the same sweeps."""
    expected = float(bending_frequencies(model.declared, 1)[0])
    curve = backbone.backbone(joint.readings, expected)
    if curve is None:
        return None
    pairs = [
        (p.recording, simulate(model, p.recording, sensor_corrected_start(model, p, start)))
        for p, start in zip(joint.prepared, joint.fit.starts, strict=True)
        if p.recording.name in curve.recordings
    ]
    return backbone.with_simulation(curve, pairs, expected)


def _comparison(campaign: Campaign, other: Campaign | None, joint: JointEstimate) -> Comparison | None:
    if other is None:
        return None
    return compare_campaigns.compare(campaign, other, joint.fit.model.declared)
