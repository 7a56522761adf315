"""The parameter file of a rig, as `--rig` reads it: format, reader and writer.

format = 1
name = "my-rig"

[parameters.bending_stiffness]
value = 0.2481
unit = "N*m^2"
standard_error = 0.0009
source = "fitted to the recordings of my-rig; declared 0.24957"

[effects.cable-torsion]
stiffness = 0.0101  # N*m/rad, standard error 0.0003

[standard_errors.cable-torsion]
stiffness = 0.0003

The table [correlations] has the correlations of all these errors: see `twin.correlations`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from twin import correlations
from twin.correlations import Correlations
from twin.errors import LARGEST, InputError, checked_number, nearest, quoted, shown
from twin.files.toml import read_toml
from twin.parameters import DEFAULTS, PARAMETERS, Parameter, Rig, rig_parameter
from twin.rigs.check import check_parameters

_KEYS = ("format", "name", "parameters", "effects", "standard_errors", "correlations")
_PARAMETER_KEYS = ("value", "unit", "uncertainty", "standard_error", "source")


def header_lines(name: str, what: str) -> list[str]:
    """Returns the first lines of a file: the name of the rig, and a comment, "A rig" and `what`."""
    return [f"# A rig {what}. SI units.", "format = 1", f"name = {_text(name)}"]


def parameter_lines(parameter: Parameter, standard_error: float | None = None) -> Iterator[str]:
    """Yields the table of a parameter.

    Args:
      parameter: the parameter.
      standard_error: of a fitted value, in its unit; None for a declared value.
    """
    yield ""
    yield f"[parameters.{parameter.name}]"
    yield f"value = {toml_number(parameter.value)}"
    yield f"unit = {_text(parameter.unit)}"
    if standard_error is None:
        if parameter.uncertainty is not None and parameter.uncertainty <= LARGEST:
            yield f"uncertainty = {toml_number(parameter.uncertainty)}  # relative, as declared"
    elif standard_error <= LARGEST:
        yield f"standard_error = {toml_number(standard_error)}"
    yield f"source = {_text(parameter.source)}"


def effect_lines(
    name: str,
    values: Mapping[str, float],
    errors: Mapping[str, float],
    units: Mapping[str, str],
    comment: str,
) -> Iterator[str]:
    """Yields the table of an effect, and that of its parameters' standard errors.

    Args:
      name: of the effect.
      values: parameter -> value, SI.
      errors: parameter -> standard error, SI; NaN, or missing, where it is unknown.
      units: parameter -> unit.
      comment: behind the head of the table.
    """
    yield ""
    yield f"[effects.{name}]  # {comment}"
    for key, value in values.items():
        error = errors.get(key, math.nan)
        notes = [units.get(key, "")] if units.get(key, "1") != "1" else []
        notes += [f"standard error {error:.2g}"] if math.isfinite(error) else []
        yield f"{key} = {toml_number(value)}" + (f"  # {', '.join(notes)}" if notes else "")
    known = {key: error for key, error in errors.items() if error <= LARGEST}
    if known:
        yield from ("", f"[standard_errors.{name}]")
        yield from (f"{key} = {toml_number(error)}" for key, error in known.items())


def toml_number(value: float) -> str:
    """Returns a number as TOML, with all digits."""
    return repr(float(value))  # "inf" and "nan" are TOML too


def _text(value: str) -> str:
    """Returns a text as a TOML string."""
    # A JSON string is a TOML one but for DEL, and for lone surrogates, which no UTF-8 file can hold.
    whole = value.encode("utf-8", "replace").decode("utf-8")
    return json.dumps(whole, ensure_ascii=False).replace("\x7f", "\\u007f")


def read_rig_file(path: str | PathLike[str]) -> tuple[Rig, dict[str, dict[str, float]]]:
    """Reads a rig with its effects from a parameter file.

    A parameter is a table as in the module's example, or a number. A standard error becomes the relative uncertainty.

    Args:
      path: the file.

    Returns:
      The rig, and effect name -> parameter name -> value (SI).

    Raises:
      InputError: the file cannot be used; the message names file and field.
    """
    return _read(Path(path))[:2]


def read_uncertainty(path: str | PathLike[str]) -> tuple[dict[str, dict[str, float]], Correlations]:
    """Reads the standard errors of effects and the correlations of all errors from a parameter file.

    The uncertainty of the rig's parameters is part of the rig, see `read_rig_file`.

    Args:
      path: the file.

    Returns:
      Effect name -> parameter name -> standard error (SI), and the correlations; both empty where there are none.

    Raises:
      InputError: the file cannot be used; the message names file and field.
    """
    return _read(Path(path))[2:]


def _read(
    path: Path,
) -> tuple[Rig, dict[str, dict[str, float]], dict[str, dict[str, float]], Correlations]:
    """Rig, effects, their standard errors, and correlations."""
    content = read_toml(path, "a rig")
    try:
        _check_keys(content, _KEYS, "")
        if content.get("format") != 1 or isinstance(content["format"], bool):
            raise InputError(f"format is {quoted(content.get('format'))}; expected format = 1")
        name = content.get("name")
        if not isinstance(name, str) or not name:
            raise InputError(f'name is {quoted(name)}; expected name = "..." of the rig')
        rig = Rig(name, _parameters(_table(content, "parameters")))
        check_parameters(rig)
        effects = checked_effects(_table(content, "effects"), rig)
        errors = _standard_errors(_table(content, "standard_errors"), effects)
        known = [*rig.parameters, *(f"{effect}.{name}" for effect, p in effects.items() for name in p)]
        return rig, effects, errors, correlations.read(_table(content, "correlations"), known)
    except InputError as error:
        raise InputError(f"{path.name}: {error}") from None


def _parameters(tables: Mapping[str, Any]) -> dict[str, Parameter]:
    parameters = {name: _parameter(name, given) for name, given in tables.items()}
    lacking = [name for name in PARAMETERS if name not in DEFAULTS and name not in parameters]
    if lacking:
        raise InputError(f"parameters: {', '.join(lacking)} missing; expected a value for each")
    for name, value in DEFAULTS.items():
        parameters.setdefault(name, rig_parameter(name, value, None, "default of the recording format"))
    return parameters


def _parameter(name: str, given: Any) -> Parameter:
    field = f"parameters.{name}"
    if name not in PARAMETERS:
        hint = nearest(name, PARAMETERS)
        raise InputError(
            f"parameters.{shown(name)} is not a parameter; expected one of: {', '.join(PARAMETERS)}{hint}"
        )
    table = given if isinstance(given, dict) else {"value": given}
    _check_keys(table, _PARAMETER_KEYS, f"{field}.")
    unit, _ = PARAMETERS[name]
    value = checked_number(f"{field}.value", table.get("value"), -math.inf, math.inf)
    if table.get("unit", unit) != unit:
        raise InputError(f"{field}.unit is {quoted(table['unit'])}; expected '{unit}'")
    uncertainty, source = _uncertainty(field, table, value), _source(field, table)
    try:
        return rig_parameter(name, value, uncertainty, source)
    except InputError as error:
        raise InputError(f"{field}: {error}") from None


def _uncertainty(field: str, table: Mapping[str, Any], value: float) -> float | None:
    """Returns the relative standard deviation, given as `uncertainty` or `standard_error`; None where neither is."""
    if "standard_error" in table:
        error = checked_number(f"{field}.standard_error", table["standard_error"], 0.0)
        return min(error / abs(value), LARGEST) if value else None
    if "uncertainty" in table:
        return checked_number(f"{field}.uncertainty", table["uncertainty"], 0.0)
    return None


def _source(field: str, table: Mapping[str, Any]) -> str:
    source = table.get("source", "parameter file")
    if not isinstance(source, str):
        raise InputError(f"{field}.source is {quoted(source)}; expected a text in quotes")
    return source


def checked_effects(tables: Mapping[str, Any], rig: Rig) -> dict[str, dict[str, float]]:
    """Returns effects, name -> parameter -> value (SI), with the neutral value of each parameter that is not given.

    Raises:
      InputError: an effect or a parameter is unknown, or no rig can have a value.
    """
    if not isinstance(tables, Mapping):
        raise InputError(f"effects is {quoted(tables)}; expected a table")
    if not tables:
        return {}
    from twin.effects import REGISTRY  # compiles equations of motion: only where it is needed

    effects = {}
    for name, given in tables.items():
        if name not in REGISTRY:
            known = ", ".join(REGISTRY)
            raise InputError(
                f"effects.{shown(name)} is not an effect; expected one of: {known}{nearest(name, REGISTRY)}"
            )
        if not isinstance(given, Mapping):
            raise InputError(f"effects.{name} is {quoted(given)}; expected a table")
        _check_keys(given, tuple(p.name for p in REGISTRY[name].parameters), f"effects.{name}.")
        effects[name] = REGISTRY[name].checked(given, rig)
    return effects


def _standard_errors(
    tables: Mapping[str, Any], effects: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, float]]:
    errors: dict[str, dict[str, float]] = {}
    for name, given in tables.items():
        field = f"standard_errors.{name}"
        if name not in effects:
            raise InputError(
                f"standard_errors.{shown(name)} is of no effect of the rig; its effects are: "
                f"{', '.join(effects) or 'none'}"
            )
        if not isinstance(given, dict):
            raise InputError(f"{field} is {quoted(given)}; expected a table")
        _check_keys(given, tuple(effects[name]), f"{field}.")
        errors[name] = {key: checked_number(f"{field}.{key}", value, 0.0) for key, value in given.items()}
    return errors


def _table(content: Mapping[str, Any], key: str) -> dict[str, Any]:
    table = content.get(key, {})
    if not isinstance(table, dict):
        raise InputError(f"{key} is {quoted(table)}; expected a table")
    return table


def _check_keys(table: Mapping[str, Any], known: tuple[str, ...], prefix: str) -> None:
    for key in table:
        if key not in known:
            raise InputError(
                f"unknown key {prefix}{shown(key)}; expected one of: {', '.join(known)}{nearest(key, known)}"
            )
