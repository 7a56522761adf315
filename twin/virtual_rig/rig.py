"""Parameters of a rig: those that a campaign declares, and those of the undeclared effects.

A `Rig` is a flat tuple of floats, which compiled code reads by name. Its defaults are the neutral rig without effects.

Sources: L. Bossi et al., "Modeling and Validation of a Planar Flexible Manipulator", ECC 2009, Table II, with
the two inertias that were only computed there re-estimated from the published frequencies 7.27 and 18.21 Hz.
"""

import math
from typing import NamedTuple


class Rig(NamedTuple):
    """True parameters of a flexible link on a driven hub, with a payload at its tip."""

    # Link, hub inertia and payload, as declared in campaign.toml.
    bending_stiffness: float = 0.24957  # N m^2
    linear_density: float = 0.09  # kg/m
    length: float = 0.42  # m
    hub_inertia: float = 6.997e-4  # kg m^2
    tip_mass: float = 0.155  # kg
    tip_inertia: float = 1.3817e-4  # kg m^2
    damping_ratio: float = 0.034  # of every flexible mode with the hub free
    torque_limit: float = 0.214  # N m, both signs

    # Friction of the hub: opposes omega while sliding, holds the hub at rest up to the static level.
    static_positive: float = 0.065  # N m, static level towards positive angles
    static_negative: float = 0.065  # N m
    coulomb_positive: float = 0.0055  # N m, while omega > 0
    coulomb_negative: float = 0.0055  # N m
    viscous_friction: float = 0.0  # N m s/rad
    stribeck_velocity: float = 0.0  # rad/s
    friction_ripple: float = 0.0  # N m, A in A (1 + sin(n theta + phi))/2
    friction_ripple_order: float = 1.0
    friction_ripple_phase: float = 0.0  # rad
    warming_rise: float = 0.0  # N m, additional Coulomb friction of a cold bearing
    warming_time: float = 10.0  # s, time constant of its decay
    bristle_stiffness: float = math.inf  # N m/rad, presliding stiffness while the hub sticks

    # The drive and other torques on the hub.
    torque_gain: float = 1.0
    torque_bias: float = 0.0  # N m
    actuator_lag: float = 0.0  # s
    actuator_delay: float = 0.0  # s
    dead_zone: float = 0.0  # N m, half width: the drive delivers the excess beyond it
    dead_band: float = (
        0.0  # N m, half width: smaller commands deliver nothing, larger ones their whole torque
    )
    torque_loss: float = (
        0.0  # share of the limit torque that iron saturation loses; grows as the square of the torque
    )
    cable_stiffness: float = 0.0  # N m/rad
    cable_rest_angle: float = 0.0  # rad
    cable_hardening: float = 0.0  # N m/rad^3
    cogging_amplitude: float = 0.0  # N m
    cogging_order: float = 1.0
    cogging_phase: float = 0.0  # rad
    backlash_gap: float = 0.0  # rad, total
    backlash_motor_share: float = 0.0  # of the hub inertia
    knock_torque: float = 0.0  # N m, of short torque pulses at irregular times
    knock_period: float = 1.0  # s, with one pulse each
    knock_phase: float = 0.0  # rad, seed of times and signs; different in each recording
    stop_angle: float = math.inf  # rad, hard stops at both signs of it
    stop_stiffness: float = 0.0  # N m/rad
    stop_damping: float = 0.0  # N m s/rad

    # The surroundings.
    tilt: float = 0.0  # rad
    tilt_direction: float = 0.0  # rad, downhill direction in the plane
    disturbance_torque: float = 0.0  # N m
    disturbance_acceleration: float = 0.0  # m/s^2, of the base along the plane's x axis
    disturbance_frequency: float = 1.0  # Hz
    disturbance_phase: float = 0.0  # rad

    # The link beyond a linear beam on a rigid clamp.
    softening: float = 0.0  # s in M = EI kappa (1 - s kappa^2/(kappa^2 + kappa_0^2))
    softening_curvature: float = 1.0  # kappa_0, 1/m
    fading: float = 0.0  # final relative loss of bending stiffness of a warming link
    fading_time: float = 10.0  # s, time constant of the loss
    root_stiffness: float = math.inf  # N m/rad, of the clamp
    torsional_frequency: float = 28.0  # Hz, with the hub locked
    torsional_damping: float = 0.01
    torsional_inertia_share: float = 0.0  # of the hub inertia, coupled to the hub by a spring
    air_drag: float = 0.0  # N s^2/m^2
    air_pad_drag: float = 0.0  # N s/m
    loose_share: float = 0.0  # of the tip mass, free to move across the link
    loose_gap: float = 0.0  # m, total, within which it is free

    # The sensors' own faults.
    hub_gain: float = 1.0
    hub_ripple: float = 0.0  # rad, A in theta + A sin(n theta + phi)
    hub_ripple_order: float = 1.0
    hub_ripple_phase: float = 0.0  # rad
    gain_base: float = 1.0
    gain_mid: float = 1.0
    drift_base: float = 0.0  # 1/s
    drift_mid: float = 0.0  # 1/s
    sensor_delay: float = 0.0  # s
    pickup_base: float = 0.0  # 1/(N m), interference of the motor current in a bridge, as strain
    pickup_mid: float = 0.0  # 1/(N m)
    clip_base: float = math.inf  # strain, the amplifier clips at both signs of it
    clip_mid: float = math.inf


# The names that campaign.toml declares, each with the fields of `Rig` that it sets.
DECLARED: dict[str, tuple[str, ...]] = {
    "bending_stiffness": ("bending_stiffness",),
    "linear_density": ("linear_density",),
    "length": ("length",),
    "hub_inertia": ("hub_inertia",),
    "tip_mass": ("tip_mass",),
    "tip_inertia": ("tip_inertia",),
    "damping_ratio": ("damping_ratio",),
    "static_friction": ("static_positive", "static_negative"),
    "coulomb_friction": ("coulomb_positive", "coulomb_negative"),
    "torque_limit": ("torque_limit",),
}

# Relative standard deviation of each declared parameter, as campaign.toml states it.
UNCERTAINTY: dict[str, float] = {
    "bending_stiffness": 0.02,
    "linear_density": 0.01,
    "length": 0.002,
    "hub_inertia": 0.03,
    "tip_mass": 0.01,
    "tip_inertia": 0.05,
    "damping_ratio": 0.1,
    "static_friction": 0.1,
    "coulomb_friction": 0.1,
}


def declared_values(rig: Rig) -> dict[str, float]:
    """Returns the values that campaign.toml declares for this rig, by their names there [SI units]."""
    return {name: getattr(rig, fields[0]) for name, fields in DECLARED.items()}


def with_declared(rig: Rig, values: dict[str, float]) -> Rig:
    """Returns the rig with some of its declared parameters replaced, by their names in campaign.toml."""
    changes = {field: float(value) for name, value in values.items() for field in DECLARED[name]}
    return rig._replace(**changes)
