"""What a bench lacks in its declaration: the kinds of benches, and the sizes of their undeclared effects."""

from collections.abc import Mapping

import numpy as np

Effects = dict[str, dict[str, float]]

BACK_EMF = "viscous-friction"
"""Effect by which the back-EMF of a motor under voltage shows at the hub."""

PATTERN = (
    "back-emf",
    "pair",
    "other",
    "nothing",
    "outside",
    "pair",
    "other",
    "back-emf",
    "nothing",
    "pair",
    "outside",
    "other",
)
"""Kinds of benches by seed, over and over: the back-EMF alone, with a second effect, another effect alone, ..."""

SIZES: Mapping[str, Mapping[str, tuple[float, float]]] = {
    BACK_EMF: {"viscous": (0.04, 0.08)},
    "backlash": {"gap": (0.01, 0.04), "motor_inertia_share": (0.3, 0.6)},
    "dead-zone": {"half_width": (0.012, 0.035)},
    "cable-torsion": {"stiffness": (0.01, 0.04), "rest_angle": (-0.5, 0.5)},
    "position-dependent-friction": {"amplitude": (0.01, 0.03), "order": (1, 4), "phase": (-3.1, 3.1)},
    "stribeck-friction": {"stribeck_velocity": (0.5, 2.5)},
    "sensor-delay": {"delay": (5e-3, 2e-2)},
    "hard-stop": {"angle": (0.25, 0.5), "stiffness": (5.0, 20.0), "damping": (0.01, 0.1)},
    "warming-friction": {"rise": (0.01, 0.025), "time_constant": (2.0, 6.0)},
    "hardening-cable": {"stiffness": (0.05, 0.4)},
    "dead-band": {"width": (0.03, 0.1)},
    "knocks": {"torque": (0.2, 0.6), "period": (1.0, 3.0)},
}
"""Effects -> parameter -> range, SI. Torques are of the order of a bench's friction, 0.02 to 0.06 N m."""

MEMBERS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "nothing": ((),),
    "back-emf": ((BACK_EMF,),),
    "other": tuple(
        (name,)
        for name in (
            "dead-zone",
            "cable-torsion",
            "backlash",
            "position-dependent-friction",
            "stribeck-friction",
            "sensor-delay",
        )
    ),
    "pair": tuple((BACK_EMF, name) for name in ("backlash", "dead-zone", "cable-torsion")),
    "outside": (
        (BACK_EMF, "hard-stop"),
        (BACK_EMF, "warming-friction"),
        ("hardening-cable",),
        (BACK_EMF, "knocks"),
        ("dead-band",),
        ("hard-stop",),
    ),
}
"""Kind -> its sets of undeclared effects, which take turns. The last effect of "outside" is not in the library."""


def kind_of(seed: int) -> str:
    """Returns the kind of the bench of a seed."""
    return PATTERN[seed % len(PATTERN)]


def missing_of(seed: int) -> tuple[str, ...]:
    """Returns the undeclared effects of the bench of a seed: those of its kind take turns."""
    rounds, place = divmod(seed, len(PATTERN))
    kind = PATTERN[place]
    turn = rounds * PATTERN.count(kind) + PATTERN[:place].count(kind)
    return MEMBERS[kind][turn % len(MEMBERS[kind])]


def drawn_effects(names: tuple[str, ...], generator: np.random.Generator) -> Effects:
    """Returns the effects with random sizes."""
    return {name: {p: _drawn(p, *limits, generator) for p, limits in SIZES[name].items()} for name in names}


def _drawn(parameter: str, low: float, high: float, generator: np.random.Generator) -> float:
    """Returns a random value: an integer order, uniform where the range contains zero, else log-uniform."""
    if parameter == "order":
        return float(generator.integers(int(low), int(high) + 1))
    if low <= 0:
        return float(generator.uniform(low, high))
    return log_uniform(low, high, generator)


def log_uniform(low: float, high: float, generator: np.random.Generator) -> float:
    """Returns a random positive value whose logarithm is uniform."""
    return float(np.exp(generator.uniform(np.log(low), np.log(high))))
