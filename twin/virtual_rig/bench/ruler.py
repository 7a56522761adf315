"""The rig of a bench: a ruler on a geared servo, and what its builders declare of it."""

import math

import numpy as np

from twin.virtual_rig.bench.kinds import Effects, log_uniform
from twin.virtual_rig.rig import Rig, declared_values

VOLTAGE_LIMIT = 10.0  # V, of the amplifier

UNCERTAINTY: dict[str, float] = {
    "bending_stiffness": 0.25,
    "linear_density": 0.08,
    "length": 0.005,
    "hub_inertia": 0.3,
    "tip_mass": 0.05,
    "damping_ratio": 0.5,
    "static_friction": 0.6,
    "coulomb_friction": 0.6,
}
"""Relative standard deviation of each declared parameter, as campaign.toml states it."""

_BY_TORQUE = (
    "bending_stiffness",
    "linear_density",
    "hub_inertia",
    "tip_mass",
    "static_friction",
    "coulomb_friction",
)
"""Parameters that an error of the torque per volt scales together, because only their ratios to a torque are seen."""
_TORQUE_ERROR = 0.04
"""Relative standard deviation of the torque per volt: that of a data sheet is within 10 %."""
_CLAMPED_FREQUENCY = 3.516
"""(beta l)^2 of the first mode of a clamped beam."""


def drawn_rig(effects: Effects, torque_per_volt: float, generator: np.random.Generator) -> Rig:
    """Returns a random rig without effects.

    Args:
        effects: Those that it will have, which decide how far the static friction exceeds that of sliding.
        torque_per_volt: Of motor and gear at rest [N m/V].
        generator: Of random numbers.
    """
    length = generator.uniform(0.3, 0.45)
    density = log_uniform(0.08, 0.25, generator)
    frequency = log_uniform(2.5, 8.0, generator)  # Hz, of the clamped ruler without payload
    stiffness = density * (2 * math.pi * frequency * length**2 / _CLAMPED_FREQUENCY) ** 2
    tip_mass = generator.uniform(0.03, 0.06) if generator.random() < 0.5 else 0.0
    coulomb = log_uniform(0.02, 0.04, generator)
    static = _static_friction(coulomb, effects, generator)
    return Rig(
        bending_stiffness=min(max(stiffness, 0.05), 1.0),
        linear_density=density,
        length=length,
        hub_inertia=log_uniform(1.5e-3, 4e-3, generator),
        tip_mass=tip_mass,
        tip_inertia=1e-4 * tip_mass,  # a cylinder of 1.4 cm radius
        damping_ratio=log_uniform(0.005, 0.02, generator),
        torque_limit=VOLTAGE_LIMIT * torque_per_volt,
        static_positive=static,
        static_negative=static,
        coulomb_positive=coulomb,
        coulomb_negative=coulomb,
    )


def _static_friction(coulomb: float, effects: Effects, generator: np.random.Generator) -> float:
    """Returns the static friction [N m]: clearly above that of sliding for Stribeck's, and above a cold bearing's."""
    if "stribeck-friction" in effects:
        return coulomb * generator.uniform(1.6, 2.2)
    cold = coulomb + effects.get("warming-friction", {}).get("rise", 0.0)
    return cold * generator.uniform(1.0, 1.5)


def declared_rig(rig: Rig, generator: np.random.Generator) -> dict[str, float]:
    """Returns what is declared of a rig, to three digits: log-normal errors, truncated at two standard deviations.

    An error of the torque per volt is one of all parameters that are seen by a torque.
    """
    torque_error = _error(_TORQUE_ERROR, generator)
    declared = declared_values(rig)
    for name, sigma in UNCERTAINTY.items():
        common = torque_error if name in _BY_TORQUE else 1.0
        declared[name] = float(f"{declared[name] * common * _error(sigma, generator):.3g}")
    declared["static_friction"] = max(declared["static_friction"], declared["coulomb_friction"])
    declared["tip_inertia"] = 1e-4 * declared["tip_mass"]
    return declared


def _error(sigma: float, generator: np.random.Generator) -> float:
    """Returns a random factor about 1."""
    return math.exp(math.log1p(sigma) * float(np.clip(generator.standard_normal(), -2.0, 2.0)))
