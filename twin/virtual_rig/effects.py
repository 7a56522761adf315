"""Effects by name, and the fields of the rig that their parameters set.

Every effect of the twin's library maps its parameters to fields of `Rig`; the equations are in `plant` and
`sensors`. A field at its default in `Rig()` is neutral: the rig is then without the effect. `OUTSIDE_EFFECTS` are
faults that the library does not contain.
"""

import math
from collections.abc import Mapping

from twin.errors import InputError, checked_number, nearest
from twin.virtual_rig.rig import Rig

EFFECTS: dict[str, dict[str, str]] = {
    # Drive and hub.
    "viscous-friction": {"viscous": "viscous_friction"},
    "stribeck-friction": {"stribeck_velocity": "stribeck_velocity"},
    "asymmetric-friction": {
        "static_positive": "static_positive",
        "static_negative": "static_negative",
        "coulomb_positive": "coulomb_positive",
        "coulomb_negative": "coulomb_negative",
    },
    "position-dependent-friction": {
        "amplitude": "friction_ripple",
        "order": "friction_ripple_order",
        "phase": "friction_ripple_phase",
    },
    "cable-torsion": {"stiffness": "cable_stiffness", "rest_angle": "cable_rest_angle"},
    "cogging": {"amplitude": "cogging_amplitude", "order": "cogging_order", "phase": "cogging_phase"},
    "torque-gain": {"gain": "torque_gain"},
    "torque-bias": {"bias": "torque_bias"},
    "dead-zone": {"half_width": "dead_zone"},
    "actuator-lag": {"time_constant": "actuator_lag"},
    "actuator-delay": {"delay": "actuator_delay"},
    "backlash": {"gap": "backlash_gap", "motor_inertia_share": "backlash_motor_share"},
    "gravity-tilt": {"tilt": "tilt", "direction": "tilt_direction"},
    "periodic-disturbance": {
        "frequency": "disturbance_frequency",
        "amplitude": "disturbance_torque",
        "phase": "disturbance_phase",
    },
    # Link and payload.
    "payload-mass": {"tip_mass": "tip_mass"},
    "stiffness-loss": {"bending_stiffness": "bending_stiffness"},
    "softening-stiffness": {"softening": "softening", "curvature": "softening_curvature"},
    "torsional-mode": {
        "frequency": "torsional_frequency",
        "damping_ratio": "torsional_damping",
        "inertia_share": "torsional_inertia_share",
    },
    "root-compliance": {"stiffness": "root_stiffness"},
    "air-drag": {"coefficient": "air_drag"},
    "air-pad-drag": {"viscous": "air_pad_drag"},
    # Sensing.
    "hub-sensor-gain": {"gain": "hub_gain"},
    "hub-sensor-nonlinearity": {
        "amplitude": "hub_ripple",
        "order": "hub_ripple_order",
        "phase": "hub_ripple_phase",
    },
    "strain-gain": {"gain_base": "gain_base", "gain_mid": "gain_mid"},
    "strain-drift": {"rate_base": "drift_base", "rate_mid": "drift_mid"},
    "sensor-delay": {"delay": "sensor_delay"},
}

OUTSIDE_EFFECTS: dict[str, dict[str, str]] = {
    "strain-amplifier-clips": {"level": "clip_base", "level_mid": "clip_mid"},
    "dead-band": {"width": "dead_band"},
    "hard-stop": {"angle": "stop_angle", "stiffness": "stop_stiffness", "damping": "stop_damping"},
    "warming-friction": {"rise": "warming_rise", "time_constant": "warming_time"},
    "shaking-base": {
        "amplitude": "disturbance_acceleration",
        "frequency": "disturbance_frequency",
        "phase": "disturbance_phase",
    },
    "saturating-motor": {"loss": "torque_loss"},
    "hardening-cable": {"stiffness": "cable_hardening"},
    "warming-link": {"loss": "fading", "time_constant": "fading_time"},
    "motor-in-strain": {"base": "pickup_base", "mid": "pickup_mid"},
    "bristles": {"stiffness": "bristle_stiffness"},
    "loose-payload": {"share": "loose_share", "gap": "loose_gap"},
    "knocks": {"torque": "knock_torque", "period": "knock_period"},
}


_SIGNED = ("rest_angle", "phase", "direction", "bias", "rate_base", "rate_mid", "base", "mid")
"""Parameters that may be negative."""
_NOT_ZERO = ("bending_stiffness",)
_LARGEST = 1e9
"""Magnitude of the largest parameter, in its unit: with larger ones the plant overflows."""


def _possible(field: str, parameter: str, value: float) -> float:
    """Returns a value that a rig can have; infinity is the neutral one of some, as of a rigid clamp."""
    if value == math.inf:
        return value
    least = -_LARGEST if parameter in _SIGNED else 1 / _LARGEST if parameter in _NOT_ZERO else 0.0
    return checked_number(field, value, least, _LARGEST)


def switch_on(rig: Rig, effects: Mapping[str, Mapping[str, float]]) -> Rig:
    """Returns the rig with these effects; a parameter that is not given stays neutral.

    Raises:
        InputError: for an unknown effect or parameter, or a value that no rig can have.
    """
    for name, parameters in effects.items():
        rig = rig._replace(**_field_changes(name, parameters))
    return rig


def _field_changes(name: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """Returns the fields of `Rig` that one effect changes, with their new values."""
    known = EFFECTS | OUTSIDE_EFFECTS
    if name not in known:
        raise InputError(f"effect is '{name}'; expected one of: {', '.join(known)}{nearest(name, known)}")
    fields = known[name]
    changes = {}
    for parameter, value in parameters.items():
        if parameter not in fields:
            raise InputError(f"{name} has no parameter '{parameter}'; expected one of: {', '.join(fields)}")
        changes[fields[parameter]] = _possible(f"{name}: {parameter}", parameter, value)
    return changes
