"""A diagnosis without its loop: hub and one bending mode, a cable that the model lacks, a slew to 90 degrees.

J theta'' + b q'' = tau - d theta' - k (theta - theta_0)
q'' + 2 zeta omega q' + omega^2 q + b theta'' = 0,   strain = c q
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import lsim

from twin.diagnosis.answer import (
    ActsLike,
    AdoptedEffect,
    Calibrated,
    ChannelError,
    Diagnosis,
    Prediction,
    Trace,
)
from twin.diagnosis.error_budget import ChannelBudget, ModelError
from twin.files.provenance import Provenance
from twin.recording import CHANNEL_UNITS, HUB_TORQUE, Recording, Sensor
from twin.rigs import preset

SENSORS = {
    "hub_angle": Sensor("hub_angle", noise=3e-4),
    "strain_base": Sensor("strain_base", noise=2e-6, position=0.02, half_thickness=0.001),
    "strain_mid": Sensor("strain_mid", noise=2e-6, position=0.21, half_thickness=0.001),
}
CABLE = {"stiffness": 0.0101, "rest_angle": 0.24}
_INERTIA, _COUPLING, _OMEGA, _ZETA = 0.03, 0.02, 2 * np.pi * 1.9, 0.02
_GAUGES = {"strain_base": 0.21, "strain_mid": 0.12}
_CLAMPED_START = 0.002  # of the modal coordinate: a tip pulled aside and let go


def simulate(
    name: str,
    torque: np.ndarray,
    rate: float,
    stiffness: float = 0.0,
    rest_angle: float = 0.0,
    viscous: float = 0.02,
    clamped: bool = False,
) -> Recording:
    """Returns hub angle and strains under a torque, from rest; clamped, the strains of a free vibration."""
    time = np.arange(len(torque)) / rate
    if clamped:
        modal = _CLAMPED_START * np.exp(-0.0057 * 7.8 * time) * np.cos(7.8 * (1 + 0.2 * stiffness) * time)
        return Recording(name, time, {"torque_command": torque, **_strains(modal)}, True, "open", 0.03)
    mass = np.array([[_INERTIA, _COUPLING], [_COUPLING, 1.0]])
    springs = np.diag([stiffness, _OMEGA**2])
    losses = np.diag([viscous, 2 * _ZETA * _OMEGA])
    inverse = np.linalg.inv(mass)
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ springs, -inverse @ losses]])
    b = np.concatenate([[0, 0], inverse[:, 0]])[:, None]
    _, angles, states = lsim((a, b, [[1, 0, 0, 0]], [[0]]), torque + stiffness * rest_angle, time)
    return Recording(
        name, time, {"torque_command": torque, "hub_angle": angles, **_strains(states[:, 1])}, loop="open"
    )


def slew(duration: float, rate: float, peak: float) -> np.ndarray:
    """Returns a bang-bang torque: forth, back, nothing."""
    time = np.arange(round(duration * rate)) / rate
    return np.where(time < 0.6, peak, np.where(time < 1.2, -peak, 0.0)) * (time > 0.05)


def multisine(duration: float, rate: float, peak: float) -> np.ndarray:
    time = np.arange(round(duration * rate)) / rate
    return peak / 3 * sum(np.sin(2 * np.pi * f * time + 2 * f) for f in (0.21, 0.47, 1.3))


def prediction(
    name: str,
    torque: np.ndarray,
    role: str,
    rate: float,
    clamped: bool = False,
    after: dict[str, float] = CABLE,
    missing: slice | None = None,
    seed: int = 0,
) -> Prediction:
    """Returns a measured recording beside what three models make of it."""
    measured = _noisy(simulate(name, torque, rate, clamped=clamped, **CABLE), seed, missing)
    models = {
        "before": simulate(name, torque, rate, clamped=clamped),
        "calibrated": simulate(name, torque, rate, clamped=clamped, viscous=0.022),
        "after": simulate(name, torque, rate, clamped=clamped, viscous=0.02005, **after),
    }
    errors, budget = {}, {}
    for channel in measured.measured():
        rms = {
            m: float(np.sqrt(np.nanmean((measured[channel] - r[channel]) ** 2))) for m, r in models.items()
        }
        errors[channel] = ChannelError(**rms, noise=SENSORS[channel].noise, unit="")
        budget[channel] = _budget(channel, measured[channel], rms)
    found = Prediction(role, measured, **models, errors=errors, budget=budget)
    return replace(found, torque=_trace([found])) if role == "holdout" and not clamped else found


def _budget(channel: str, measured: np.ndarray, rms: dict[str, float]) -> ChannelBudget:
    """Returns the budget of a channel; errors in windows are a tenth of those of whole runs."""
    spread = float(np.nanstd(measured))
    errors = {
        m: ModelError(e, e / 10, 100 * (1 - e / spread), 100 * (1 - 0.1 * e / spread)) for m, e in rms.items()
    }
    steps = (("cable-torsion", errors["after"]),)
    return ChannelBudget(CHANNEL_UNITS[channel], SENSORS[channel].noise, **errors, steps=steps)


def diagnosis(duration: float = 2.0, rate: float = 250.0, **changes) -> Diagnosis:
    """Returns a whole diagnosis, "explained" by cable torsion unless `changes` say otherwise.

    Args:
      duration: of every recording [s].
      rate: samples per second.
      changes: attributes of the diagnosis to replace.
    """
    n = round(duration * rate)
    predictions = {
        "multisine.csv": prediction("multisine.csv", multisine(duration, rate, 0.09), "fit", rate, seed=1),
        "bang-bang-45.csv": prediction("bang-bang-45.csv", slew(duration, rate, 0.09), "fit", rate, seed=2),
        "ring-down.csv": prediction("ring-down.csv", np.zeros(n), "fit", rate, clamped=True, seed=3),
        "bang-bang-90.csv": prediction(
            "bang-bang-90.csv", slew(duration, rate, 0.18), "holdout", rate, missing=slice(200, 230), seed=4
        ),
        "release.csv": prediction("release.csv", np.zeros(n), "holdout", rate, clamped=True, seed=5),
    }
    declared = preset("bossi2009")
    fitted = declared.replace(
        source="calibrated", bending_stiffness=0.2481, hub_inertia=1.07 * declared["hub_inertia"]
    )
    whole = Diagnosis(
        campaign="bench rig",
        verdict="explained",
        summary="The hub is pulled back towards 14 degrees in proportion to its angle. "
        "Wires to the strain bridges do that.",
        effects=(
            AdoptedEffect(
                "cable-torsion",
                CABLE,
                {"stiffness": 0.00031, "rest_angle": 0.021},
                {"stiffness": "N*m/rad", "rest_angle": "rad"},
                0.982,
            ),
        ),
        ranking=(
            ("cable-torsion", 812.4),
            ("gravity-tilt", 640.2),
            ("cogging", 122.0),
            ("torque-bias", 40.1),
            ("viscous-friction", 3.2),
            ("payload-mass", 0.4),
            ("air-drag", 0.0),
        ),
        indistinguishable=(("cable-torsion", "gravity-tilt"),),
        next_experiment="Record a slow slew over a full turn: gravity changes its sign, a cable does not.",
        depends_on=("hub_angle",),
        calibrated={
            "bending_stiffness": Calibrated(declared["bending_stiffness"], 0.2481, 0.0009, "N*m^2"),
            "hub_inertia": Calibrated(
                declared["hub_inertia"], fitted["hub_inertia"], 0.004 * fitted["hub_inertia"], "kg*m^2"
            ),
        },
        predictions=predictions,
        traces=(_trace([p for p in predictions.values() if p.role == "fit"]),),
        notes=("bang-bang-90.csv: 30 samples of hub_angle are missing.", "Sensor noise is taken as white."),
        declared=declared,
        fitted=fitted,
        wall_s=41.3,
        threshold=30.0,
        false_alarm_rate=0.01,
        by_chance=9.8,
        least_score=30.0,
        not_fitted=("payload-mass", "air-drag"),
        provenance=Provenance(
            "0.1.0",
            "2026-01-02T03:04:05+00:00",
            "twin diagnose bench",
            {"campaign.toml": "ab" * 32, "bang-bang-90.csv": "cd" * 32},
            {"permutation_test": 0},
        ),
    )
    whole = replace(whole, **changes)
    if whole.effects:
        return whole
    return replace(whole, predictions={f: _without_steps(p) for f, p in whole.predictions.items()})


def _without_steps(prediction: Prediction) -> Prediction:
    budget = {c: replace(b, steps=(), after=b.calibrated) for c, b in prediction.budget.items()}
    return replace(prediction, budget=budget)


def outside(**changes) -> Diagnosis:
    """Returns a diagnosis that found something which no effect explains."""
    return diagnosis(
        verdict="outside-library",
        summary="A torque acts on the hub for 0.1 s at a time that nothing else has in common.",
        effects=(),
        indistinguishable=(),
        depends_on=("time", "hub_rate"),
        acts_like=ActsLike(HUB_TORQUE, ("time", "hub_rate"), 80.0),
        **changes,
    )


def nothing_missing(**changes) -> Diagnosis:
    """Returns a diagnosis that found nothing missing."""
    found = diagnosis(
        verdict="no-missing-effect",
        summary="Calibrated within its uncertainty the model predicts all recordings.",
        effects=(),
        ranking=(("viscous-friction", 1.2), ("cogging", -0.3)),
        indistinguishable=(),
        depends_on=(),
        next_experiment=None,
        traces=(),
        **changes,
    )
    return replace(found, predictions={f: _without_effect(p) for f, p in found.predictions.items()})


def _without_effect(prediction: Prediction) -> Prediction:
    errors = {
        name: replace(e, before=1.04 * e.after, calibrated=e.after) for name, e in prediction.errors.items()
    }
    return replace(prediction, before=prediction.after, calibrated=prediction.after, errors=errors)


def _strains(modal: np.ndarray) -> dict[str, np.ndarray]:
    return {channel: factor * modal for channel, factor in _GAUGES.items()}


def _noisy(recording: Recording, seed: int, missing: slice | None) -> Recording:
    rng = np.random.default_rng(seed)
    channels = dict(recording.channels)
    for channel in recording.measured():
        noise = SENSORS[channel].noise * rng.standard_normal(len(recording))
        channels[channel] = channels[channel] + noise
    if missing is not None:
        channels["hub_angle"] = channels["hub_angle"].copy()
        channels["hub_angle"][missing] = np.nan
    return recording.replace(channels=channels)


def _trace(fit: list[Prediction]) -> Trace:
    """Returns the torque of the cable with an estimator's noise, where the hub turns."""
    moving = [(i, p.measured) for i, p in enumerate(fit) if "hub_angle" in p.measured]
    angle = np.concatenate([r["hub_angle"] for _, r in moving])
    rate = np.concatenate(
        [np.gradient(p.after["hub_angle"], p.after.time) for p in fit if "hub_angle" in p.after]
    )
    ends = np.cumsum([0.0] + [r.duration for _, r in moving])
    true = -CABLE["stiffness"] * (angle - CABLE["rest_angle"])
    rng = np.random.default_rng(7)
    time = np.concatenate([r.time + start for (_, r), start in zip(moving, ends, strict=False)])
    return Trace(
        channel="hub_torque",
        time=time,
        values=true + 1.2e-3 * rng.standard_normal(len(true)),
        variables={
            "hub_angle": angle,
            "hub_rate": rate,
            "torque_command": np.concatenate([r["torque_command"] for _, r in moving]),
            "time": time,
        },
        recording=np.concatenate([np.full(len(r), i) for i, r in moving]),
        since_start=np.concatenate([r.time - r.time[0] for _, r in moving]),
        explained_by="hub_angle",
        fitted=true,
    )
