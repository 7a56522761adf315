"""What is fuzzed: valid files for each reader, and the reader with what it has to keep of what it accepts."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fuzz_mutations import CONTROLLER, CSV, FILE, TOML, Kind

from twin.campaigns.campaign import read_campaign
from twin.control import closed_loop, plants
from twin.control.laws import library
from twin.errors import LARGEST
from twin.mechanics.beam import rigid_inertia
from twin.parameters import PARAMETERS, Rig
from twin.report.compare import compare, read_tracks, remarks
from twin.rigs import preset
from twin.rigs.patch import read_patch
from twin.rigs.rig_file import header_lines, parameter_lines, read_rig_file, read_uncertainty
from twin.validation.requirements import DEFAULTS, read_requirements

_STEPS = 10  # samples that are simulated
_SEGMENTS = 3


@dataclass(frozen=True)
class Target:
    """One kind of input.

    Attributes:
      name: for the table.
      file: name of the file that is broken.
      files: all files of the folder.
      kinds: of mutations.
      read: reads the folder and checks what it accepts: an AssertionError is a wrong object.
    """

    name: str
    file: str
    files: Mapping[str, bytes]
    kinds: tuple[Kind, ...]
    read: Callable[[Path], object]


# Valid files


def _rows(header: str, *columns: np.ndarray) -> bytes:
    rows = [",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)]
    return ("\n".join([header, *rows]) + "\n").encode()


@functools.cache
def _recording(peak: float, seed: int) -> bytes:
    """A rigid hub that a sinusoidal torque turns, and strain in proportion, with noise."""
    rng, time, rig = np.random.default_rng(seed), 0.004 * np.arange(400), preset("bossi2009")
    torque, w = peak * np.sin(2 * np.pi * time), 2 * np.pi
    turn = peak / (w * rigid_inertia(rig)) * (time - np.sin(w * time) / w)
    noise = rng.standard_normal((2, len(time)))
    header = "time,torque_command,hub_angle,strain_base"
    return _rows(header, time, torque, turn + 3e-4 * noise[0], 2e-3 * torque + 2e-6 * noise[1])


CAMPAIGN = b"""# a rig on a table
format = 1
name = "fuzzed"
rig = "my-rig"

[parameters]
length = 0.42
linear_density = 0.09
bending_stiffness = 0.25
hub_inertia = 0.0007
tip_mass = 0.155
tip_inertia = 0.000138
damping_ratio = 0.034
static_friction = 0.065
coulomb_friction = 0.0055
torque_limit = 0.214

[uncertainty]
bending_stiffness = 0.02
length = 0.002

[channels.torque_command]
unit = "N*m"

[channels.hub_angle]
unit = "rad"
noise = 0.0003

[channels.strain_base]
unit = "1"
noise = 2e-06
position = 0.02
half_thickness = 0.001

[static]
second_moment = 2.95e-11

[[recordings]]
file = "push.csv"
experiment = "push"
role = "fit"

[[recordings]]
file = "pull.csv"
experiment = "pull"
role = "holdout"
"""
_STATIC = b"force,displacement\n0.1,0.0099\n0.2,0.0198\n0.3,0.0296\n0.4,0.0396\n"
_PATCH = (
    b"hub_angle,added_to_hub_torque,samples\n-1,-0.01,30\n-0.5,-0.004,40\n0,0,50\n0.5,0.005,40\n1,0.011,20\n"
)
_LAW = b"def law(measured, reference):\n    return 0.3 * (reference - measured['hub_angle'])\n"


def _folder() -> dict[str, bytes]:
    return {
        "campaign.toml": CAMPAIGN,
        "push.csv": _recording(0.2, 0),
        "pull.csv": _recording(-0.2, 1),
        "static.csv": _STATIC,
    }


def _rig_file() -> bytes:
    rig = preset("bossi2009")
    lines = header_lines("my-rig", "to be broken")
    for parameter in rig.parameters.values():
        lines += parameter_lines(parameter)
    lines += [
        "",
        "[effects.cable-torsion]",
        "stiffness = 0.012",
        "rest_angle = 0.15",
        "",
        "[effects.actuator-lag]",
        "time_constant = 0.008",
        "",
        "[standard_errors.cable-torsion]",
        "stiffness = 0.0001",
        "",
        "[correlations]",
        'of = ["length", "cable-torsion.stiffness"]',
        "matrix = [[1.0, 0.5], [0.5, 1.0]]",
    ]
    return ("\n".join(lines) + "\n").encode()


def _requirements() -> bytes:
    return ("share = 0.9\n" + "".join(f"{r.name} = {r.limit}\n" for r in DEFAULTS)).encode()


# Readers, and what they have to keep


def _check_rig(rig: Rig) -> None:
    for name, (_, (low, high)) in PARAMETERS.items():
        assert low <= rig[name] <= high, f"{name} = {rig[name]}"
        uncertainty = rig.parameters[name].uncertainty
        assert uncertainty is None or 0 <= uncertainty < math.inf, f"uncertainty of {name} = {uncertainty}"


def _check_series(time: np.ndarray, channels: Mapping[str, np.ndarray]) -> None:
    assert len(time) > 1, "fewer than two samples"
    assert (np.diff(time) > 0).all(), "time does not increase"
    assert np.isfinite(time).all(), "time is not finite"
    for name, values in channels.items():
        known = values[~np.isnan(values)]
        assert (np.abs(known) <= LARGEST).all(), f"{name} has values beyond {LARGEST:g}"


def _campaign(folder: Path) -> object:
    campaign = read_campaign(folder)
    _check_rig(campaign.rig)
    for recording in (*campaign.fit, *campaign.holdout()):
        _check_series(recording.time, recording.channels)
    for sensor in campaign.sensors.values():
        assert sensor.noise is None or 0 < sensor.noise < math.inf, f"noise of {sensor.channel}"
        assert 0 <= sensor.position <= campaign.rig["length"], f"position of {sensor.channel}"
        assert 0 <= sensor.half_thickness < math.inf, f"half_thickness of {sensor.channel}"
    return campaign


def _simulate(plant: plants.Plant) -> None:
    with np.errstate(all="ignore"):
        plant.reset()
        for k in range(_STEPS):
            plant.advance(0.1 * k)
            closed_loop._check_divergence(plant)
        assert all(math.isfinite(value) for value in plant.read().values()), "a reading is not finite"


def _rig(folder: Path) -> object:
    rig, effects = read_rig_file(folder / "rig.toml")
    errors, _ = read_uncertainty(folder / "rig.toml")
    _check_rig(rig)
    assert all(0 <= error < math.inf for own in errors.values() for error in own.values()), "standard error"
    _simulate(plants.make_plant("compiled", rig, effects, segments=_SEGMENTS))
    return rig


def _limits(folder: Path) -> object:
    limits = read_requirements(folder / "requirements.toml")
    assert 0 < limits.share <= 1, "share"
    assert limits.limits, "no limits"
    assert all(math.isfinite(r.limit) for r in limits.limits.values()), "a limit is not finite"
    return limits


def _patched(folder: Path) -> object:
    patch = read_patch(folder / "patch.csv")
    _check_series(patch.x, {"y": patch.y})
    assert np.isfinite(patch.y).all(), "a value is not finite"
    _simulate(plants.make_plant("compiled", segments=_SEGMENTS, patch=patch))
    return patch


def _compared(folder: Path) -> object:
    tracks = read_tracks([folder / "good.csv", folder / "run.csv"], preset("bossi2009"))
    for track in tracks:
        _check_series(track.time, track.channels)
    rows = compare(tracks)
    list(remarks(tracks))
    assert all(math.isfinite(row.rms) for row in rows), "a difference is not finite"
    return rows


def _controlled(folder: Path) -> object:
    plant = plants.make_plant("compiled", segments=_SEGMENTS)
    law = library.controller(f"{folder / 'law.py'}:law", preset("bossi2009"), plant.period)
    run = closed_loop.run(plant, law, lambda time: 1.0, _STEPS * plant.period)
    assert np.isfinite(run.torque_command).all(), "a torque is not finite"
    return run


@functools.cache
def targets() -> tuple[Target, ...]:
    """Returns all targets."""
    folder, run = _folder(), _recording(0.2, 0)
    return (
        Target("campaign", "campaign.toml", folder, TOML + FILE, _campaign),
        Target("recording", "push.csv", folder, CSV + FILE, _campaign),
        Target("static", "static.csv", folder, CSV + FILE, _campaign),
        Target("rig", "rig.toml", {"rig.toml": _rig_file()}, TOML + FILE, _rig),
        Target(
            "requirements", "requirements.toml", {"requirements.toml": _requirements()}, TOML + FILE, _limits
        ),
        Target("patch", "patch.csv", {"patch.csv": _PATCH}, CSV + FILE, _patched),
        Target("run", "run.csv", {"good.csv": _recording(0.2, 2), "run.csv": run}, CSV + FILE, _compared),
        Target("controller", "law.py", {"law.py": _LAW}, CONTROLLER + FILE, _controlled),
    )
