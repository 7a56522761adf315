"""The format of `campaign.toml` as pydantic models, and error messages in terms of the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from twin.campaigns.units import DERIVED_UNITS, TIME
from twin.errors import InputError, nearest, shown
from twin.parameters import PARAMETERS
from twin.recording import CHANNEL_UNITS

FILE = "campaign.toml"
"""Name of the file in the campaign's folder."""


def _number(value: Any) -> Any:
    # pydantic would accept True and "0.2" as numbers.
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("expected a number")
    return value


Number = Annotated[float, BeforeValidator(_number)]
Finite = Annotated[Number, Field(allow_inf_nan=False)]
Text = Annotated[str, Field(min_length=1, max_length=1000)]  # no system has longer names of files

Positive = Annotated[Finite, Field(gt=0.0)]
Uncertainty = Annotated[Finite, Field(ge=0.0, le=1.0)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Channel(_Table):
    """One `[channels.<name>]` table.

    Attributes:
      column: the CSV column; None for the channel's name.
      unit: unit of the recorded values.
      noise: standard deviation of the sensor noise, in `unit`.
      gain: physical = gain * (raw - offset).
      offset: raw value at physical zero.
      position: distance of a strain gauge from the hub axis along the link [m].
      half_thickness: distance of a strain gauge from the neutral axis [m].
      offset_uncertainty: standard deviation of `offset`, in `unit`; 0 for a zero that is certain.
      offset_per: whether the offset is that of the whole campaign or differs between recordings.
      gain_uncertainty: relative standard deviation of the gain.
      delay_uncertainty: standard deviation of the delay of the readings [s].
      sees_gain: of `motor_torque`, whether it sees an error of the drive's gain.
    """

    unit: str
    column: Text | None = None
    noise: Annotated[Finite, Field(ge=0.0)] | None = None
    gain: Finite | None = None
    offset: Finite = 0.0
    position: Annotated[Finite, Field(ge=0.0)] | None = None
    half_thickness: Annotated[Finite, Field(gt=0.0)] | None = None
    offset_uncertainty: Annotated[Finite, Field(ge=0.0)] | None = None
    offset_per: Literal["campaign", "recording"] = "recording"
    gain_uncertainty: Annotated[Finite, Field(ge=0.0)] | None = None
    delay_uncertainty: Annotated[Finite, Field(ge=0.0)] | None = None
    sees_gain: bool | None = None


class DriveEntry(_Table):
    """The `[drive]` table: what a command is, and the constants of motor and gear.

    Attributes:
      kind: what the command asks for: a torque at the hub, a current or a voltage of the motor.
      resistance: of the winding [ohm].
      torque_constant: [N m/A].
      back_emf_constant: [V s/rad]; None for that of an ideal motor, which is the torque constant.
      gear_ratio: turns of the motor per turn of the hub.
      efficiency: share of the motor's torque that reaches the hub.
      limit: largest magnitude of the command, in its unit.
      *_uncertainty: relative standard deviation of each.
    """

    kind: Literal["torque", "current", "voltage"] = "torque"
    resistance: Positive | None = None
    resistance_uncertainty: Uncertainty | None = None
    torque_constant: Positive | None = None
    torque_constant_uncertainty: Uncertainty | None = None
    back_emf_constant: Annotated[Finite, Field(ge=0.0)] | None = None
    back_emf_constant_uncertainty: Uncertainty | None = None
    gear_ratio: Positive = 1.0
    gear_ratio_uncertainty: Uncertainty | None = None
    efficiency: Annotated[Finite, Field(gt=0.0, le=1.0)] = 1.0
    efficiency_uncertainty: Uncertainty | None = None
    limit: Positive | None = None
    limit_uncertainty: Uncertainty | None = None


class RecordingEntry(_Table):
    """One `[[recordings]]` table.

    Attributes:
      file: name of the CSV file in the folder.
      role: "fit", or "holdout" for a recording on which predictions are tested.
      experiment: label for people.
      clamped, loop, start, initial_tip_deflection: see `Recording`.
    """

    file: Text
    role: Literal["fit", "holdout"]
    experiment: str = ""
    clamped: bool = False
    loop: Literal["open", "closed"] = "open"
    start: Literal["rest", "unknown"] = "rest"
    initial_tip_deflection: Finite | None = None


class StaticEntry(_Table):
    """The `[static]` table, of `static.csv`; `second_moment` is I of the link's section [m^4]."""

    second_moment: Annotated[Finite, Field(gt=0.0)] | None = None


class CampaignFile(_Table):
    """The whole of `campaign.toml`."""

    format: Annotated[Literal[1], BeforeValidator(_number)]
    name: Text
    rig: Text
    parameters: dict[str, Number] = {}
    uncertainty: dict[str, Annotated[Finite, Field(ge=0.0)]] = {}
    channels: Annotated[dict[str, Channel], Field(min_length=1)]
    recordings: Annotated[list[RecordingEntry], Field(min_length=1)]
    static: StaticEntry = StaticEntry()
    drive: DriveEntry = DriveEntry()


_NAMES = {
    "parameters": ("parameter", tuple(PARAMETERS)),
    "uncertainty": ("parameter", tuple(PARAMETERS)),
    "channels": ("channel", (TIME, *CHANNEL_UNITS, *DERIVED_UNITS)),
}
_TABLES: Mapping[str, type[_Table]] = {
    "channels": Channel,
    "recordings": RecordingEntry,
    "static": StaticEntry,
    "drive": DriveEntry,
}


def parse(content: Mapping[str, Any]) -> CampaignFile:
    """Returns the content of a `campaign.toml`, checked.

    Raises:
      InputError: it is not in the format; one line per error.
    """
    unknown = list(_unknown_names(content))
    if unknown:
        raise InputError("\n".join(unknown))
    try:
        return CampaignFile.model_validate(content)
    except ValidationError as error:
        raise InputError("\n".join(_error_lines(error, content))) from None


def _unknown_names(content: Mapping[str, Any]) -> Iterator[str]:
    for table, (kind, known) in _NAMES.items():
        names = content.get(table, {})
        for name in names if isinstance(names, dict) else ():
            if name not in known:
                expected = f"expected one of: {', '.join(known)}{nearest(name, known)}"
                yield f"{FILE}: {table}.{shown(name)} is not a {kind}; {expected}"


def _error_lines(error: ValidationError, content: Mapping[str, Any]) -> Iterator[str]:
    # Unknown keys first: a misspelt key is also reported as missing.
    details = sorted(error.errors(), key=lambda detail: detail["type"] != "extra_forbidden")
    for detail in details:
        yield f"{FILE}: {_error_text(detail['type'], detail['loc'], detail, content)}"


def _error_text(kind: str, loc: tuple[int | str, ...], detail: Any, content: Mapping[str, Any]) -> str:
    field = _field(loc, content)
    value = _toml(detail["input"])
    if kind == "extra_forbidden":
        known = tuple(_model(loc).model_fields)
        return f"unknown key {field}; expected one of: {', '.join(known)}{nearest(str(loc[-1]), known)}"
    if kind == "missing":
        return f"{field} is missing{_meaning(str(loc[-1]))}"
    if kind == "literal_error":
        choices = get_args(_model(loc).model_fields[str(loc[-1])].annotation)
        expected = ", ".join(_toml(choice) for choice in choices)
        hint = nearest(str(detail["input"]), map(str, choices))
        return f"{field} is {value}; expected one of: {expected}{hint}"
    if kind == "too_short":
        return f"{field} is empty; expected at least one"
    expected = _EXPECTED.get(kind, detail["msg"]).format(**detail.get("ctx", {}))
    return f"{field} is {value}; expected {expected}"


# Kind of pydantic error -> what is expected.
_EXPECTED = {
    "value_error": "a number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "greater_than": "a number > {gt:g}",
    "greater_than_equal": "a number >= {ge:g}",
    "less_than_equal": "a number <= {le:g}",
    "bool_type": "true or false",
    "string_type": "a text in quotes",
    "string_too_short": "a text that is not empty",
    "string_too_long": "a text of at most {max_length} characters",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "list_type": "a list of [[...]] tables",
}

# Missing key -> what is expected.
_MEANINGS = {
    "format": "; expected format = 1",
    "name": '; expected name = "..." of the campaign',
    "rig": '; expected rig = "..." with the name of a preset or of your rig',
    "unit": '; expected unit = "..." of the column',
    "role": '; expected role = "fit" or role = "holdout"',
    "file": '; expected file = "..." of the recording',
    "channels": "; expected one [channels.<name>] table per channel",
    "recordings": "; expected one [[recordings]] table per file",
}


def _meaning(key: str) -> str:
    return _MEANINGS.get(key, "")


def _model(loc: tuple[int | str, ...]) -> type[_Table]:
    return _TABLES[str(loc[0])] if len(loc) > 1 else CampaignFile


def _field(loc: tuple[int | str, ...], content: Mapping[str, Any]) -> str:
    """Returns the location of an error as in the file, counted from 1: `recordings[3] (multisine.csv)`."""
    words: list[str] = []
    for key in loc:
        if isinstance(key, int) and words:
            words[-1] += f"[{key + 1}]{_file_of(content, key)}"
        else:
            words.append(shown(str(key)))
    return ".".join(words)


def _file_of(content: Mapping[str, Any], index: int) -> str:
    entry = content["recordings"][index]
    file = entry.get("file") if isinstance(entry, dict) else None
    return f" ({shown(file)})" if isinstance(file, str) else ""


def _toml(value: Any) -> str:
    """Returns a value as it is written in TOML; tables and lists by name."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return "a list"
    return f"'{shown(value)}'" if isinstance(value, str) else str(value)
