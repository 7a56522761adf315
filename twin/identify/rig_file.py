"""The identified rig as a parameter file that every command reads with `--rig`; see `twin.augmented`."""

from __future__ import annotations

import json
from collections.abc import Iterator

from twin.correlations import of_covariance
from twin.identify.identification import Identification
from twin.parameters import Parameter

FILE = "identified-rig.toml"


def to_toml(found: Identification) -> str:
    """Returns the identified rig as TOML, with standard errors that become its uncertainty when it is read."""
    lines = ["# A rig as it was identified. SI units.", "format = 1", f"name = {json.dumps(found.campaign)}"]
    for parameter in found.rig.parameters.values():
        lines += ["", *_lines(found, parameter)]
    lines += of_covariance(found.joint.names, found.joint.covariance).lines()
    return "\n".join(lines) + "\n"


def _lines(found: Identification, parameter: Parameter) -> Iterator[str]:
    name = parameter.name
    yield f"[parameters.{name}]"
    identified = found.parameters.get(name)
    if identified is None:
        yield f"value = {float(parameter.value)!r}"
        yield f"unit = {json.dumps(parameter.unit)}"
        if parameter.uncertainty is not None:
            yield f"uncertainty = {float(parameter.uncertainty)!r}  # relative, as declared"
        yield f"source = {json.dumps(parameter.source)}"
        return
    yield f"value = {identified.value!r}"
    yield f"unit = {json.dumps(identified.unit)}"
    yield f"standard_error = {identified.standard_error!r}"
    said = f"identified from the recordings of {found.campaign}; declared {identified.declared:.6g}"
    yield f"source = {json.dumps(said)}"
