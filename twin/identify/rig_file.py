"""The identified rig as a parameter file that every command reads with `--rig`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from twin.correlations import of_covariance
from twin.identify.identification import Identification
from twin.parameters import Parameter
from twin.rig_file import header, parameter_lines

FILE = "identified-rig.toml"


def to_toml(found: Identification) -> str:
    """Returns the identified rig as TOML, with standard errors that become its uncertainty when it is read."""
    lines = header(found.campaign, "as it was identified")
    for parameter in found.rig.parameters.values():
        lines += _parameter_lines(found, parameter)
    lines += of_covariance(found.joint.names, found.joint.covariance).lines()
    return "\n".join(lines) + "\n"


def _parameter_lines(found: Identification, parameter: Parameter) -> Iterator[str]:
    identified = found.parameters.get(parameter.name)
    if identified is None:
        return parameter_lines(parameter)
    source = f"identified from the recordings of {found.campaign}; declared {identified.declared:.6g}"
    return parameter_lines(
        replace(parameter, value=identified.value, source=source), identified.standard_error
    )
