"""Results of the single procedures of an identification as plain values for JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin.identification.backbone import Backbone
from twin.identification.balance import Balance
from twin.identification.break_away import StaticFriction
from twin.identification.decay import Decay
from twin.identification.estimates import Estimate, interval_json
from twin.identification.friction_map import FrictionMap
from twin.identification.joint import JointEstimate
from twin.identification.total_inertia import MomentumBalance


def estimate(quantity: Estimate, unit: str) -> dict[str, Any]:
    """Returns value, standard error, 95 % interval and unit of a quantity."""
    return {
        "value": quantity.value,
        "standard_error": quantity.standard_error,
        "interval": interval_json(quantity),
        "unit": unit,
    }


def total_inertia(momentum: MomentumBalance | None, joint: Estimate) -> dict[str, Any]:
    """Returns the total inertia J by the angular-momentum balance and by the joint estimate."""
    return {
        "slews": None if momentum is None else estimate(momentum.inertia, "kg*m^2"),
        "determination": None if momentum is None else momentum.determination,
        "joint": estimate(joint, "kg*m^2"),
    }


def backbone(curve: Backbone) -> dict[str, Any]:
    """Returns the backbone curve of the first resonance; slopes are relative changes at the largest amplitude."""
    beyond = curve.residual_slope
    return {
        "recordings": list(curve.recordings),
        "channel": curve.channel,
        "amplitude": curve.amplitude.tolist(),
        "frequency_hz": [f.value for f in curve.frequency],
        "frequency_standard_error": [f.standard_error for f in curve.frequency],
        "small_vibration": estimate(curve.small_amplitude, "Hz"),
        "slope": estimate(curve.slope, "1"),
        "moves": curve.depends_on_amplitude,
        "simulated_slope": curve.simulated_slope,
        "beyond_the_model": None if beyond is None else estimate(beyond, "1"),
    }


def friction_map(release: FrictionMap) -> dict[str, Any]:
    """Returns the map from Coulomb friction to equivalent damping, and the measured damping on it."""
    return {
        "recording": release.recording,
        "coulomb_friction": release.coulomb.tolist(),
        "equivalent_damping_ratio": release.damping.tolist(),
        "measured": estimate(release.measured, "1"),
        "initial_tip_deflection": release.deflection,
        "level": None if release.level is None else estimate(release.level, "N*m"),
    }


def loss_law(decay: Decay) -> dict[str, Any]:
    """Returns the losses of a ring-down, a_t = -(c0 + c1 a + c2 a^2) with a in units of the channel."""
    return {
        "recording": decay.recording,
        "channel": decay.channel,
        "law": decay.law,
        "significance": decay.law_significance,
        "losses": list(decay.losses),
        "by_decrement": estimate(decay.by_decrement, "1"),
        "by_fit": estimate(decay.by_fit, "1"),
        "frequency_slope": estimate(decay.frequency_slope, "1"),
    }


def levels(friction: StaticFriction, hub: Balance | None) -> dict[str, Any]:
    """Returns static and Coulomb friction by direction."""
    return {
        "static_friction": _by_direction(friction.by_direction),
        "static_angle_spread": friction.angle_spread,
        "coulomb_friction": _by_direction(hub.coulomb if hub is not None and hub.accepted else {}),
        "coulomb_determination": None if hub is None else hub.determination,
    }


def _by_direction(levels: Mapping[int, Estimate]) -> dict[str, Any]:
    return {
        "positive" if direction > 0 else "negative": estimate(level, "N*m")
        for direction, level in levels.items()
    }


def correlations(joint: JointEstimate, trusted: bool) -> dict[str, Any]:
    """Returns the correlation matrix of the joint estimate and its correlated pairs, with errors if `trusted`."""
    return {
        "parameters": list(joint.names),
        "matrix": joint.correlation.tolist(),
        "tied": [_correlated_pair(joint, trusted, *pair) for pair in joint.correlated_pairs()],
    }


def _correlated_pair(
    joint: JointEstimate, trusted: bool, a: str, b: str, correlation: float
) -> dict[str, Any]:
    power, error = joint.best_known_product(a, b)
    return {
        "parameters": [a, b],
        "correlation": correlation,
        "power": power,
        "relative_standard_error": error if trusted else None,
    }
