"""What the procedures of an identification found, as structured plain values beside their sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin.identification.backbone import Backbone
from twin.identification.balance import Balance
from twin.identification.break_away import StaticFriction
from twin.identification.decay import Decay
from twin.identification.estimates import Estimate
from twin.identification.friction_map import FrictionMap
from twin.identification.joint import Joint
from twin.identification.total_inertia import Momentum


def estimate(found: Estimate, unit: str) -> dict[str, Any]:
    """A number with its error, interval and unit."""
    return {
        "value": found.value,
        "standard_error": found.standard_error,
        "interval": list(found.interval),
        "unit": unit,
    }


def total_inertia(whole: Momentum | None, joint: Estimate) -> dict[str, Any]:
    """J of the whole rig by its angular momentum and by what the joint estimate adds up to."""
    return {
        "slews": None if whole is None else estimate(whole.inertia, "kg*m^2"),
        "determination": None if whole is None else whole.determination,
        "joint": estimate(joint, "kg*m^2"),
    }


def backbone(found: Backbone) -> dict[str, Any]:
    """How the first resonance moves with amplitude; slopes are relative changes at the largest one."""
    return {
        "recordings": list(found.recordings),
        "channel": found.channel,
        "amplitude": found.amplitude.tolist(),
        "frequency_hz": [f.value for f in found.frequency],
        "frequency_standard_error": [f.standard_error for f in found.frequency],
        "small_vibration": estimate(found.small, "Hz"),
        "slope": estimate(found.slope, "1"),
        "moves": found.moves,
        "simulated_slope": found.simulated,
        "beyond_the_model": None if found.beyond is None else estimate(found.beyond, "1"),
    }


def friction_map(found: FrictionMap) -> dict[str, Any]:
    """The map from Coulomb friction to equivalent damping, and where the measurement lies on it."""
    return {
        "recording": found.recording,
        "coulomb_friction": found.coulomb.tolist(),
        "equivalent_damping_ratio": found.damping.tolist(),
        "measured": estimate(found.measured, "1"),
        "initial_tip_deflection": found.deflection,
        "level": None if found.level is None else estimate(found.level, "N*m"),
    }


def loss_law(found: Decay) -> dict[str, Any]:
    """The losses of a ring-down: a_t = -(c0 + c1 a + c2 a^2), a in units of the channel."""
    return {
        "recording": found.recording,
        "channel": found.channel,
        "law": found.law,
        "significance": found.law_significance,
        "losses": list(found.losses),
        "by_decrement": estimate(found.by_decrement, "1"),
        "by_fit": estimate(found.by_fit, "1"),
        "frequency_slope": estimate(found.frequency_slope, "1"),
    }


def levels(friction: StaticFriction, hub: Balance | None) -> dict[str, Any]:
    """Static and Coulomb friction by direction."""
    return {
        "static_friction": _by_direction(friction.by_direction),
        "static_angle_spread": friction.angle_spread,
        "coulomb_friction": _by_direction(hub.coulomb if hub is not None and hub.believed else {}),
        "coulomb_determination": None if hub is None else hub.determination,
    }


def _by_direction(found: Mapping[int, Estimate]) -> dict[str, Any]:
    return {
        "positive" if direction > 0 else "negative": estimate(level, "N*m")
        for direction, level in found.items()
    }


def correlations(found: Joint) -> dict[str, Any]:
    """What moves together in the joint estimate: the matrix, and the products that are known best."""
    return {
        "parameters": list(found.names),
        "matrix": found.correlation.tolist(),
        "tied": [_tie(found, *pair) for pair in found.tied()],
    }


def _tie(found: Joint, a: str, b: str, correlation: float) -> dict[str, Any]:
    power, error = found.combination(a, b)
    return {
        "parameters": [a, b],
        "correlation": correlation,
        "power": power,
        "relative_standard_error": error,
    }
