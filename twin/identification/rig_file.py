"""The identified rig as a parameter file, which every command reads with `--rig`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from twin.correlations import from_covariance
from twin.effects import REGISTRY
from twin.identification.result import Identification
from twin.parameters import Parameter
from twin.rigs.rig_file import effect_lines, header_lines, parameter_lines

FILE = "identified-rig.toml"
_WHAT = {
    True: "as it was identified",
    False: "as it fits recordings that contradict its model: uncertainties are the declared ones, and `twin diagnose` "
    "says what the model lacks",
}
"""Whether the identification is trusted -> what the file holds."""


def to_toml(result: Identification) -> str:
    """Returns the identified rig as TOML, with standard errors that are its uncertainty when it is read."""
    joint = result.procedures.joint
    lines = header_lines(result.campaign, _WHAT[result.trust.trusted])
    for parameter in result.rig.parameters.values():
        lines += _parameter_lines(result, parameter)
    for effect, values in joint.fit.model.effects.items():
        known = {name: result.effects.get(f"{effect}.{name}") for name in values}
        errors = {name: p.standard_error for name, p in known.items() if p is not None}
        lines += effect_lines(
            effect, values, errors, REGISTRY[effect].units(values), "known, and identified with the rig"
        )
    if result.trust.trusted:
        lines += from_covariance(joint.names, joint.covariance).lines()
    return "\n".join(lines) + "\n"


def _parameter_lines(result: Identification, parameter: Parameter) -> Iterator[str]:
    identified = result.parameters.get(parameter.name)
    if identified is None:
        return parameter_lines(parameter)
    if not result.trust.trusted:
        source = (
            f"best fit to {result.campaign}, which contradicts the model; declared {identified.declared:.6g}"
        )
        return parameter_lines(replace(parameter, value=identified.value, source=source))
    reason = result.not_determined.get(parameter.name)
    how = "identified from" if reason is None else "not determined by"
    source = f"{how} the recordings of {result.campaign}; declared {identified.declared:.6g}"
    error = identified.standard_error
    if reason is not None:
        source, error = f"{source}; {reason}", max(error, identified.declared_error or 0.0)
    return parameter_lines(replace(parameter, value=identified.value, source=source), error)
