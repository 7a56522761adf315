"""The augmented rig of a diagnosis: declared and fitted parameters and adopted effects, as parameter file and MJCF."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from twin.diagnosis.answer import Diagnosis, KnownEffect
from twin.files.whole import write_file, writing
from twin.parameters import Parameter
from twin.recording import Sensor
from twin.rigs.rig_file import effect_lines, header_lines, parameter_lines

if TYPE_CHECKING:
    from twin.rigs.mjcf_export import AugmentedMjcf

FILE = "augmented-rig.toml"


def write_augmented(diagnosis: Diagnosis, folder: str | PathLike[str]) -> Path:
    """Writes the final rig of a diagnosis as `augmented-rig.toml`.

    Args:
      diagnosis: its fitted rig, declared and adopted effects are written.
      folder: where to; created if necessary.

    Returns:
      Path of the file.

    Raises:
      InputError: the file cannot be written.
    """
    path = Path(folder) / FILE
    with writing(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, to_toml(diagnosis))
    return path


def to_toml(diagnosis: Diagnosis) -> str:
    """Returns the augmented rig as TOML."""
    what = {
        "explained": "with the effects that its model lacked",
        "no-missing-effect": "calibrated; nothing was missing",
        "outside-library": "with what could be explained; something that no known effect explains is left",
    }[diagnosis.verdict]
    lines = header_lines(diagnosis.campaign, what)
    for parameter in diagnosis.fitted.parameters.values():
        lines += _parameter_lines(diagnosis, parameter)
    for known in diagnosis.known:
        lines += _effect_lines(known, "declared, and fitted anew")
    for effect in diagnosis.effects:
        lines += _effect_lines(effect, f"probability {effect.probability:.3g} among the candidates tried")
    lines += diagnosis.correlations.lines()
    return "\n".join(lines) + "\n"


def to_mjcf(diagnosis: Diagnosis, sensors: Mapping[str, Sensor]) -> AugmentedMjcf:
    """Returns the augmented rig as MJCF.

    Args:
      diagnosis: its fitted rig, declared and adopted effects are written.
      sensors: channel -> sensor; strain gauges become MuJoCo sensors.
    """
    from twin.rigs import mjcf_export  # compiles equations of motion: only where it is needed

    effects = {effect.name: dict(effect.parameters) for effect in (*diagnosis.known, *diagnosis.effects)}
    names = ", ".join(effect.name for effect in diagnosis.effects) or "none"
    known = ", ".join(effect.name for effect in diagnosis.known)
    comment = [
        f"The rig of campaign '{diagnosis.campaign}' as diagnosed by twin.",
        *([f"Effects that it was declared with: {known}."] if known else []),
        f"Effects that the declared model lacked: {names}.",
    ]
    return mjcf_export.to_mjcf(diagnosis.fitted, effects, sensors, comment)


def _effect_lines(effect: KnownEffect, comment: str) -> Iterator[str]:
    return effect_lines(effect.name, effect.parameters, effect.standard_errors, effect.units, comment)


def _parameter_lines(diagnosis: Diagnosis, parameter: Parameter) -> Iterator[str]:
    moved = diagnosis.calibrated.get(parameter.name)
    if moved is None:
        return parameter_lines(parameter)
    source = f"fitted to the recordings of {diagnosis.campaign}; declared {moved.declared:.6g}"
    return parameter_lines(replace(parameter, source=source), moved.standard_error)
