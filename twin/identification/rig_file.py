"""The identified rig as a parameter file that every command reads with `--rig`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from twin.correlations import from_covariance
from twin.effects import REGISTRY
from twin.identification.identify import Identification
from twin.parameters import Parameter
from twin.rigs.rig_file import effect_lines, header, parameter_lines

FILE = "identified-rig.toml"


def to_toml(found: Identification) -> str:
    """Returns the identified rig as TOML, with standard errors that become its uncertainty when it is read."""
    lines = header(found.campaign, "as it was identified")
    for parameter in found.rig.parameters.values():
        lines += _parameter_lines(found, parameter)
    for effect, values in found.joint.fit.model.effects.items():
        known = {name: found.effects.get(f"{effect}.{name}") for name in values}
        errors = {name: p.standard_error for name, p in known.items() if p is not None}
        lines += effect_lines(
            effect, values, errors, REGISTRY[effect].units(values), "known, and identified with the rig"
        )
    lines += from_covariance(found.joint.names, found.joint.covariance).lines()
    return "\n".join(lines) + "\n"


def _parameter_lines(found: Identification, parameter: Parameter) -> Iterator[str]:
    identified = found.parameters.get(parameter.name)
    if identified is None:
        return parameter_lines(parameter)
    why = found.not_determined.get(parameter.name)
    told = "identified from" if why is None else "not determined by"
    source = f"{told} the recordings of {found.campaign}; declared {identified.declared:.6g}"
    error = identified.standard_error
    if why is not None:
        source, error = f"{source}; {why}", max(error, identified.declared_error or 0.0)
    return parameter_lines(replace(parameter, value=identified.value, source=source), error)
