"""Campaigns of the virtual rig for the benchmark of the diagnosis: undeclared effects and their sizes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.effects import REGISTRY
from twin.rigs import preset
from twin.virtual_rig.sensors import DIRT

Kind = Literal["single", "small", "pair", "triple", "far", "nothing", "outside"]
Effects = dict[str, dict[str, float]]
Engine = Literal["virtual-rig", "exudyn"]


@dataclass(frozen=True)
class Size:
    """Distribution of a parameter.

    Attributes:
      low, high: range.
      how: "log": log-uniform; "signed": log-uniform with a random sign; "around": a log-uniform relative distance
        above or below `about`; "below": the same, always below; "uniform"; "integer": uniform over whole numbers.
      about: the neutral value of "around" and "below".
    """

    low: float
    high: float
    how: Literal["log", "signed", "around", "below", "uniform", "integer"] = "log"
    about: float = 1.0

    def draw(self, generator: np.random.Generator) -> float:
        """Returns a random value."""
        if self.how == "uniform":
            return float(generator.uniform(self.low, self.high))
        if self.how == "integer":
            return float(generator.integers(int(self.low), int(self.high) + 1))
        size = float(np.exp(generator.uniform(np.log(self.low), np.log(self.high))))
        sign = float(generator.choice([-1, 1]))
        match self.how:
            case "signed":
                return sign * size
            case "around":
                return self.about * (1 + sign * size)
            case "below":
                return self.about * (1 - size)
        return size


_PHASE = Size(-3.1, 3.1, "uniform")
SIZES: Mapping[str, Mapping[str, Size]] = {
    "viscous-friction": {"viscous": Size(8e-4, 5e-3)},
    "stribeck-friction": {"stribeck_velocity": Size(0.15, 1.5)},
    "asymmetric-friction": {
        "static_positive": Size(0.05, 0.2, "around", 0.065),
        "static_negative": Size(0.05, 0.2, "around", 0.065),
        "coulomb_positive": Size(3e-3, 1.2e-2),
        "coulomb_negative": Size(3e-3, 1.2e-2),
    },
    "position-dependent-friction": {
        "amplitude": Size(4e-3, 2e-2),
        "order": Size(1, 12, "integer"),
        "phase": _PHASE,
    },
    "cable-torsion": {"stiffness": Size(3e-3, 2e-2), "rest_angle": Size(-0.5, 0.5, "uniform")},
    "cogging": {"amplitude": Size(3e-3, 1.5e-2), "order": Size(2, 14, "integer"), "phase": _PHASE},
    "torque-gain": {"gain": Size(0.02, 0.1, "around")},
    "torque-bias": {"bias": Size(1e-3, 6e-3, "signed")},
    "actuator-lag": {"time_constant": Size(2e-3, 2e-2)},
    "actuator-delay": {"delay": Size(3e-3, 2e-2)},
    "backlash": {"gap": Size(3e-3, 3e-2), "motor_inertia_share": Size(0.2, 0.6)},
    "gravity-tilt": {"tilt": Size(3e-3, 3e-2), "direction": _PHASE},
    "periodic-disturbance": {
        "frequency": Size(0.6, 15.0),
        "amplitude": Size(3e-3, 1.5e-2),
        "phase": _PHASE,
    },
    "shaking-base": {"frequency": Size(0.8, 12.0), "amplitude": Size(0.03, 0.3), "phase": _PHASE},
    "payload-mass": {"tip_mass": Size(0.04, 0.15, "around", 0.155)},
    "stiffness-loss": {"bending_stiffness": Size(0.07, 0.2, "below", 0.24957)},
    "softening-stiffness": {"softening": Size(0.08, 0.35), "curvature": Size(0.5, 1.5)},
    "torsional-mode": {
        "frequency": Size(20.0, 35.0),
        "damping_ratio": Size(5e-3, 5e-2),
        "inertia_share": Size(0.05, 0.3),
    },
    "root-compliance": {"stiffness": Size(5.0, 60.0)},
    "air-drag": {"coefficient": Size(0.02, 0.2)},
    "air-pad-drag": {"viscous": Size(5e-3, 5e-2)},
    "hub-sensor-gain": {"gain": Size(0.01, 0.06, "around")},
    "hub-sensor-nonlinearity": {
        "amplitude": Size(4e-3, 3e-2),
        "order": Size(1, 6, "integer"),
        "phase": _PHASE,
    },
    "strain-gain": {"gain_base": Size(0.02, 0.1, "around"), "gain_mid": Size(0.02, 0.1, "around")},
    "strain-drift": {"rate_base": Size(5e-7, 1e-5, "signed"), "rate_mid": Size(5e-7, 1e-5, "signed")},
    "sensor-delay": {"delay": Size(2e-3, 1.2e-2)},
}
"""Effects of the library -> parameter -> distribution, with sizes from a few noise levels up."""
NAMED: Mapping[str, str] = {"shaking-base": "periodic-disturbance"}
"""Name of an effect on the virtual rig -> in the library, where they differ."""

FAR: Effects = {
    "viscous-friction": {"viscous": 0.02},
    "stribeck-friction": {"stribeck_velocity": 4.0},
    "asymmetric-friction": {
        "static_positive": 0.03,
        "static_negative": 0.1,
        "coulomb_positive": 0.002,
        "coulomb_negative": 0.03,
    },
    "position-dependent-friction": {"amplitude": 0.04, "order": 2, "phase": 1.0},
    "cable-torsion": {"stiffness": 0.06, "rest_angle": 0.6},
    "cogging": {"amplitude": 0.04, "order": 18, "phase": -1.0},
    "torque-gain": {"gain": 0.7},
    "torque-bias": {"bias": 0.02},
    "actuator-lag": {"time_constant": 0.06},
    "actuator-delay": {"delay": 0.06},
    "backlash": {"gap": 0.08, "motor_inertia_share": 0.5},
    "gravity-tilt": {"tilt": 0.08, "direction": 2.0},
    "periodic-disturbance": {"frequency": 0.3, "amplitude": 0.04, "phase": 0.3},
    "shaking-base": {"frequency": 2.0, "amplitude": 1.0, "phase": 0.3},
    "payload-mass": {"tip_mass": 0.28},
    "stiffness-loss": {"bending_stiffness": 0.14},
    "softening-stiffness": {"softening": 0.6, "curvature": 1.0},
    "torsional-mode": {"frequency": 16.0, "damping_ratio": 0.03, "inertia_share": 0.5},
    "root-compliance": {"stiffness": 1.5},
    "air-drag": {"coefficient": 0.6},
    "air-pad-drag": {"viscous": 0.15},
    "hub-sensor-gain": {"gain": 0.85},
    "hub-sensor-nonlinearity": {"amplitude": 0.08, "order": 2, "phase": 1.0},
    "strain-gain": {"gain_base": 0.7, "gain_mid": 1.25},
    "strain-drift": {"rate_base": 4e-5, "rate_mid": -3e-5},
    "sensor-delay": {"delay": 0.04},
}
"""Sizes two to five times the largest of `SIZES`."""

OUTSIDE: Mapping[str, Mapping[str, Size]] = {
    "strain-amplifier-clips": {"level": Size(8e-5, 2e-4), "level_mid": Size(5e-5, 1.2e-4)},
    "dead-band": {"width": Size(8e-3, 3e-2)},
    "hard-stop": {"angle": Size(0.3, 0.7), "stiffness": Size(2.0, 20.0), "damping": Size(0.01, 0.1)},
    "warming-friction": {"rise": Size(5e-3, 2e-2), "time_constant": Size(1.5, 5.0)},
    "saturating-motor": {"loss": Size(0.1, 0.4)},
    "hardening-cable": {"stiffness": Size(0.02, 0.2)},
    "warming-link": {"loss": Size(0.03, 0.15), "time_constant": Size(2.0, 6.0)},
    "motor-in-strain": {"base": Size(1e-4, 1e-3, "signed"), "mid": Size(1e-4, 1e-3, "signed")},
    "bristles": {"stiffness": Size(3.0, 30.0)},
    "loose-payload": {"share": Size(0.2, 0.6), "gap": Size(1e-3, 1e-2)},
    "knocks": {"torque": Size(0.05, 0.3), "period": Size(1.0, 4.0)},
}
"""Faults that the library does not contain -> parameter -> distribution."""

DEPENDS: Mapping[str, Sequence[str]] = {
    "strain-amplifier-clips": ("strain_base", "strain_mid"),
    "dead-band": ("torque_command",),
    "hard-stop": ("hub_angle",),
    "warming-friction": ("time", "hub_rate", "direction"),
    "saturating-motor": ("torque_command",),
    "hardening-cable": ("hub_angle",),
    "warming-link": ("time", "strain_base", "strain_mid"),
    "motor-in-strain": ("torque_command",),
    "bristles": ("hub_travel", "hub_rate"),
    "loose-payload": ("tip_rate", "strain_base", "strain_mid"),
    "knocks": ("time",),
}
"""Fault -> variables, one of which a correct diagnosis names first as what the residual depends on."""


VIRTUAL_RIG_ALONE: Mapping[str, str] = {
    "softening-stiffness": "softening",
    "loose-payload": "loose_share",
}
"""Effect that Exudyn's engine does not have -> field of the rig that is not zero with it."""


@dataclass(frozen=True)
class Case:
    """One campaign.

    Attributes:
      kind: class of its undeclared effects.
      missing: undeclared effects.
      seed: of all random numbers.
      dirty: kinds of defects in its data.
      perturb: standard deviation of the true parameters about the declared ones, over their uncertainty [1].
      torque_sensor: whether the motor torque is measured.
      engine: what simulates its recordings.
    """

    kind: Kind
    missing: tuple[str, ...]
    seed: int
    dirty: tuple[str, ...] = ()
    perturb: float = 0.5
    torque_sensor: bool = True
    engine: Engine = "virtual-rig"

    @property
    def name(self) -> str:
        """Name of the campaign; it does not reveal the effect."""
        return f"rig-{self.seed}"

    def effects(self) -> Effects:
        """Returns the undeclared effects with parameters drawn by the seed."""
        if self.kind == "far":
            return {name: FAR[name] for name in self.missing}
        generator = np.random.default_rng([self.seed, 7])
        sizes = {**SIZES, **OUTSIDE}
        drawn = {
            name: {parameter: size.draw(generator) for parameter, size in sizes[name].items()}
            for name in self.missing
        }
        if self.kind == "small":
            share = _SMALL.draw(generator)
            return {name: shrunk(name, values, share) for name, values in drawn.items()}
        return drawn


def shrunk(name: str, values: Mapping[str, float], share: float) -> dict[str, float]:
    """Returns the values of an effect at a share of their distance from neutral."""
    effect = REGISTRY[NAMED.get(name, name)]
    neutral, result = effect.neutral(preset("bossi2009")), dict(values)
    for p in effect.parameters:
        if p.name in values and p.name not in effect.undefined_at_neutral:
            before, full = p.turned(neutral[p.name]), p.turned(values[p.name])
            result[p.name] = p.turned(before + share * (full - before))
    return result


_SMALL = Size(0.02, 1.0)
"""Share of the usual distance from neutral of a small effect, down to the noise."""
# Combinations of defects, in the order in which campaigns get them.
_DIRT = (*((kind,) for kind in DIRT), ("spikes", "missing-fields"))


def cases(
    each: int,
    small: int,
    nulls: int,
    pairs: int,
    triples: int,
    far: int,
    outside: int,
    seed: int,
    dirty: bool = False,
    engines: Sequence[Engine] = ("virtual-rig",),
) -> Iterator[Case]:
    """Yields the campaigns with their kinds interleaved, so that the first ones are a fair sample.

    Every fifth one has defective data, with `dirty` every one. Every other one has no torque sensor. Every third one
    with nothing missing has exactly the declared parameters. Engines take turns, two campaigns each; the virtual rig
    takes the effects that it alone has.

    Args:
      each, small: usual and small campaigns of each effect.
      nulls: with nothing missing.
      pairs, triples: with two and three effects.
      far: with one effect of `FAR`.
      outside: with a fault of `OUTSIDE`.
      seed: of the first campaign and of the drawn combinations.
      dirty: whether every campaign has a defect in its data.
      engines: what simulates the campaigns.
    """
    draw = np.random.default_rng(seed)
    every = list(SIZES)
    kinds: list[tuple[float, Kind, tuple[str, ...]]] = []
    kinds += [((k + 0.5) / each, "single", (name,)) for name in every for k in range(each)]
    kinds += [((k + 0.5) / small, "small", (name,)) for name in every for k in range(small)]
    kinds += [((k + 0.5) / far, "far", (every[k % len(every)],)) for k in range(far)]
    kinds += [((k + 0.5) / nulls, "nothing", ()) for k in range(nulls)]
    together: list[tuple[Kind, int, int]] = [("pair", pairs, 2), ("triple", triples, 3)]
    for kind, count, effects in together:
        for k in range(count):
            drawn = tuple(every[i] for i in draw.choice(len(every), effects, replace=False))
            kinds.append(((k + 0.5) / count, kind, drawn))
    faults = list(OUTSIDE)
    kinds += [((k + 0.5) / outside, "outside", (faults[k % len(faults)],)) for k in range(outside)]
    for number, (_, kind, missing) in enumerate(sorted(kinds, key=lambda item: item[0])):
        turn = number if dirty else number // 5
        dirt = _DIRT[turn % len(_DIRT)] if dirty or number % 5 == 4 else ()
        perturb = 0.0 if kind == "nothing" and number % 3 == 0 else 0.5
        engine = engines[number // 2 % len(engines)]
        if VIRTUAL_RIG_ALONE.keys() & set(missing):
            engine = "virtual-rig"
        yield Case(kind, missing, seed + number, dirt, perturb, number % 2 == 0, engine)
