"""Final estimate of each parameter, and which parameters the recordings do not determine."""

from __future__ import annotations

from collections.abc import Mapping

from twin.campaigns.campaign import Campaign
from twin.effects import REGISTRY
from twin.identification import joint
from twin.identification.estimates import TWO_SIDED_95, Estimate, Identified, IntervalBy
from twin.identification.joint import JointEstimate
from twin.identification.parameter_estimates import estimates_by_procedure
from twin.identification.procedures import Procedures
from twin.parameters import declared_range

_MAX_ERROR = 0.7  # standard error over the declared one above which a parameter counts as not determined [1]
_MIN_ERROR = 1e-5  # the same, below: the likelihood is not smooth in it, and its derivatives mean nothing [1]


def identified_parameters(campaign: Campaign, results: Procedures) -> dict[str, Identified]:
    """Returns the final estimate of each parameter of the rig, and by effect.parameter of declared effects."""
    methods = estimates_by_procedure(campaign.rig, results)
    return {name: _identified(campaign, name, results.joint, methods[name]) for name in results.joint.names}


def _identified(
    campaign: Campaign, name: str, joint_estimate: JointEstimate, methods: dict[str, Estimate]
) -> Identified:
    # Motion contains no information on the static friction: it is read at break-aways, or stays as declared.
    best = methods.get("break-away" if name == "static_friction" else "joint")
    unit, declared, prior, interval = _declaration(campaign, name)
    if best is None:
        return Identified(declared, prior or 0.0, unit, declared, prior, methods, interval, "declaration")
    by: IntervalBy = (
        "profile" if name in joint_estimate.intervals else "covariance" if best.profile is None else "range"
    )
    return Identified(best.value, best.standard_error, unit, declared, prior, methods, best.profile, by)


def _declaration(
    campaign: Campaign, name: str
) -> tuple[str, float, float | None, tuple[float, float] | None]:
    """Unit, declared value, its standard deviation and its 95 % interval; None for what is not declared."""
    if name in campaign.rig:
        parameter = campaign.rig.parameters[name]
        interval = declared_range(parameter, TWO_SIDED_95)
        return parameter.unit, parameter.value, joint.prior_deviation(campaign.rig, name), interval
    effect, _, parameter_name = name.partition(".")
    values = campaign.effects[effect]
    error = campaign.effect_errors.get(effect, {}).get(parameter_name)
    return REGISTRY[effect].units(values)[parameter_name], values[parameter_name], error, None


def not_determined(parameters: Mapping[str, Identified], joint_estimate: JointEstimate) -> dict[str, str]:
    """Returns parameter -> reason, for each one that the recordings hardly determine beyond its declaration."""
    reasons = {name: "stands at the end of its range" for name in joint_estimate.at_bounds()}
    for name, p in parameters.items():
        if p.declared_error and p.standard_error > _MAX_ERROR * p.declared_error:
            pairs = joint_estimate.correlated_pairs()
            partners = [b if a == name else a for a, b, _ in pairs if name in (a, b)]
            reasons[name] = (
                f"strongly correlated with {partners[0]}"
                if partners
                else "the recordings add little to the declaration"
            )
        elif p.declared_error and p.standard_error < _MIN_ERROR * p.declared_error:
            reasons[name] = (
                "the likelihood is not smooth in it, so that its small standard error means nothing"
            )
    return reasons
