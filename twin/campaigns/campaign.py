"""A campaign, the recordings of one rig with its declared parameters, read from a folder and checked."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path, PurePath
from types import MappingProxyType

import numpy as np

from twin import rigs
from twin.campaigns import check_channels, check_rig, schema, units
from twin.campaigns.declaration_warnings import declaration_warnings
from twin.campaigns.derived_channels import derive, derived_sensors
from twin.campaigns.drive import RawCommand, check_drive, known_effects, raw_command, torque_per_command
from twin.campaigns.missing import check_complete, parse
from twin.errors import InputError, listed, nearest, shown
from twin.files.readers import read_recording
from twin.files.table import Table, read_table
from twin.files.time_column import checked_time
from twin.files.toml import read_toml
from twin.parameters import DEFAULTS, Parameter, Rig, rig_parameter
from twin.recording import MEASURED, Recording, Sensor
from twin.rigs.check import check_parameters

STATIC_FILE = "static.csv"
"""File name of the static load test."""
_COMMAND = "torque_command"
_OF_A_CURVATURE = 1e-3
"""Half thickness of a gauge that is calibrated in curvature [m], where none is declared: it is a factor of the measured
and of the simulated strain alike, so that any value will do."""


@dataclass(frozen=True)
class StaticTest:
    """A static load test, its columns as recorded.

    Attributes:
      columns: name -> (n) values in the unit of the file; NaN where one is missing.
      second_moment: second moment of area I of the link's section [m^4]; None where not declared.
    """

    columns: Mapping[str, np.ndarray] = field(repr=False)
    second_moment: float | None = None

    def __post_init__(self) -> None:
        frozen = {name: _read_only(values) for name, values in self.columns.items()}
        object.__setattr__(self, "columns", MappingProxyType(frozen))

    def __getitem__(self, column: str) -> np.ndarray:
        return self.columns[column]

    def __contains__(self, column: str) -> bool:
        return column in self.columns

    def __reduce__(self):
        return (type(self), (dict(self.columns), self.second_moment))


@dataclass(frozen=True, eq=False)
class Campaign:
    """Recordings of one rig in SI units.

    Attributes:
      name: for people.
      rig: declared parameters; the uncertainty of a parameter is None where the campaign does not declare it.
      sensors: channel -> how it was measured, SI.
      fit: recordings that may be used to find and fit effects.
      static: static load test, if there is one.
      warnings: a sentence for each oddity of the data.
      effects: name of each effect known to act on the rig -> parameter -> value, SI.
      effect_errors: name of effect -> parameter -> standard error, SI; without one, the value is only a rough one.
      raw_command: what a command in V or A nominally does; None of one in N m.
    """

    name: str
    rig: Rig
    sensors: Mapping[str, Sensor]
    fit: tuple[Recording, ...]
    static: StaticTest | None = None
    warnings: tuple[str, ...] = ()
    _held_out: tuple[Recording, ...] = field(default=(), repr=False)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    effect_errors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    raw_command: RawCommand | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", MappingProxyType(dict(self.sensors)))

    def holdout(self) -> tuple[Recording, ...]:
        """Returns the held-out recordings, on which prediction errors are reported; they may not be used for fits."""
        return self._held_out

    def __reduce__(self):
        first = (self.name, self.rig, dict(self.sensors), self.fit, self.static, self.warnings)
        return (type(self), (*first, self._held_out, self.effects, self.effect_errors, self.raw_command))

    @property
    def torque_per_volt(self) -> float | None:
        """Nominal [N m/V], where the command is a voltage of which no drive is declared; otherwise None."""
        raw = self.raw_command
        return raw.torque if raw is not None and raw.unit == "V" and not raw.is_of_drive else None


def read_campaign(folder: str | os.PathLike[str]) -> Campaign:
    """Reads the campaign in a folder: `campaign.toml`, the recordings it names, `static.csv`.

    Args:
      folder: the folder with `campaign.toml`.

    Raises:
      InputError: the campaign cannot be used; the message names file and line or field.
    """
    root = _folder(Path(folder))
    content = _content(root)
    check_drive(content)
    check_complete(content)
    rig = _declared_rig(content)
    check_parameters(rig)
    _check_channels(content, rig)
    _check_recordings(content, rig)
    read = [_read_recording(root, entry, content, rig) for entry in content.recordings]
    _check_columns(content, [table for _, table, _ in read])
    sensors = derived_sensors(_sensors(content), content.drive.gear_ratio, rig["length"])
    recordings, stuck = check_rig.without_stuck_channels([r for r, _, _ in read], sensors, rig)
    check_channels.check_signs_and_units(recordings, sensors, rig)
    check_rig.check_torque(recordings, sensors, rig)
    check_rig.check_distinct(recordings)
    fit, held_out = _by_role(content, recordings)
    check_rig.check_motion(fit, sensors)
    idle = check_rig.immobile_hub_notes(recordings, sensors, rig)
    effects, errors = known_effects(content.drive)
    return Campaign(
        name=content.name,
        rig=rig,
        sensors=sensors,
        fit=fit,
        static=_read_static(root, content.static.second_moment),
        warnings=(
            *declaration_warnings(content),
            *chain.from_iterable(notes for *_, notes in read),
            *stuck,
            *idle,
        ),
        _held_out=held_out,
        effects=effects,
        effect_errors=errors,
        raw_command=raw_command(content),
    )


def campaign_files(folder: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Returns the paths of all files of the campaign in a folder, whether they exist or not.

    Raises:
      InputError: its `campaign.toml` cannot be used.
    """
    root = _folder(Path(folder))
    content = _content(root)
    return (root / schema.FILE, root / STATIC_FILE, *(root / entry.file for entry in content.recordings))


def _folder(path: Path) -> Path:
    """Returns the path; raises InputError where it is no folder with a `campaign.toml`."""
    if path.is_file():
        hint = f"; did you mean '{path.parent}'?" if path.name == schema.FILE else ""
        raise InputError(f"{path} is a file; expected a folder with {schema.FILE}{hint}")
    if not path.is_dir():
        raise InputError(f"{path}: there is no such folder; expected a folder with {schema.FILE}")
    if not (path / schema.FILE).exists():
        raise InputError(f"{path} has no {schema.FILE}; expected a campaign folder")
    return path


def _content(root: Path) -> schema.CampaignFile:
    return parse(read_toml(root / schema.FILE, "a campaign"))


def _by_role(
    content: schema.CampaignFile, recordings: Iterable[Recording]
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    # Roles are known here only: the search and the fits receive the first tuple alone.
    pairs = list(zip(content.recordings, recordings, strict=True))
    fit = tuple(recording for entry, recording in pairs if entry.role == "fit")
    if not fit:
        raise InputError(f'{schema.FILE}: no recording has role = "fit"; expected at least one to fit with')
    return fit, tuple(recording for entry, recording in pairs if entry.role == "holdout")


# The rig


def _declared_rig(content: schema.CampaignFile) -> Rig:
    if content.rig in rigs.PRESETS:
        start = rigs.preset(content.rig).parameters
        # A published uncertainty is of another specimen: the campaign has to declare its own.
        base = {name: replace(parameter, uncertainty=None) for name, parameter in start.items()}
    else:
        base = _default_parameters()
    given = dict(content.parameters)
    if content.drive.limit is not None:
        given.setdefault("torque_limit", content.drive.limit * _limit_scale(content))
    declared = {name: _declared_parameter(name, value) for name, value in given.items()}
    parameters = {**base, **declared}
    return Rig(content.rig, {name: _with_uncertainty(p, content) for name, p in parameters.items()})


def _limit_scale(content: schema.CampaignFile) -> float:
    """Torque per unit of the command, as `limit` counts it [N m]."""
    command = content.channels.get(_COMMAND)
    scale = 1.0 if command is None else _factor(_COMMAND, command)
    if command is not None and content.drive.kind == "torque":
        scale *= abs(command.gain or 1.0)
    return scale * torque_per_command(content.drive)


def _default_parameters() -> dict[str, Parameter]:
    """Returns the default parameters of a rig without a preset."""
    return {name: _default_parameter(name, value) for name, value in DEFAULTS.items()}


def _default_parameter(name: str, value: float) -> Parameter:
    uncertainty = 1.0 if name == "damping_ratio" else None
    return rig_parameter(name, value, uncertainty, "default of the recording format")


def _declared_parameter(name: str, value: float) -> Parameter:
    try:
        return rig_parameter(name, value, None, schema.FILE)
    except InputError as error:
        raise InputError(f"{schema.FILE}: parameters.{error}") from None


def _with_uncertainty(parameter: Parameter, content: schema.CampaignFile) -> Parameter:
    if parameter.name not in content.uncertainty:
        return parameter
    return replace(parameter, uncertainty=content.uncertainty[parameter.name])


# Channels


def _check_channels(content: schema.CampaignFile, rig: Rig) -> None:
    for name, channel in content.channels.items():
        _check_channel(f"{schema.FILE}: channels.{name}", name, channel, rig)
    if not any(name in content.channels for name in MEASURED):
        expected = ", ".join(MEASURED)
        raise InputError(f"{schema.FILE}: channels has no measurement; expected one of: {expected}")
    columns = Counter(channel.column or name for name, channel in content.channels.items())
    column, uses = columns.most_common(1)[0]
    if uses > 1:
        raise InputError(
            f"{schema.FILE}: channels: column '{column}' serves {uses} channels; expected one column for each"
        )


def _check_channel(where: str, name: str, channel: schema.Channel, rig: Rig) -> None:
    _check_unit(where, name, channel)
    if name == units.TIME:
        _check_time(where, channel)
    if channel.gain == 0.0:
        raise InputError(f"{where}.gain is 0; expected the physical value of one {channel.unit}")
    if units.is_strain(name):
        _check_gauge(where, channel, rig)


def _check_time(where: str, channel: schema.Channel) -> None:
    # Time is read from the card's clock: only the name of its column can be declared.
    for key in channel.model_fields_set - {"column", "unit"}:
        raise InputError(f"{where}.{key} has no meaning for the time; expected column and unit only")


def _check_unit(where: str, name: str, channel: schema.Channel) -> None:
    try:
        units.scale(name, channel.unit, _half_thickness(channel))
    except InputError as error:
        raise InputError(f"{where}.unit: {error}") from None


def _check_gauge(where: str, channel: schema.Channel, rig: Rig) -> None:
    if channel.position is not None and channel.position > rig["length"]:
        raise InputError(
            f"{where}.position is {channel.position:g} m; "
            f"expected 0 to {rig['length']:g} m, the length of the link"
        )


def _sensors(content: schema.CampaignFile) -> dict[str, Sensor]:
    return {name: _sensor(name, ch) for name, ch in content.channels.items() if name != units.TIME}


def _sensor(name: str, channel: schema.Channel) -> Sensor:
    # The noise is declared in the channel's unit: where that is V or A, the gain converts it.
    raw = abs(channel.gain or 1.0) if units.raw_unit(channel.unit) else 1.0
    noise = channel.noise * raw * _factor(name, channel) if channel.noise else None
    return Sensor(
        name,
        noise,
        channel.position or 0.0,
        _half_thickness(channel),
        zero_is_certain=channel.offset_uncertainty == 0,
        sees_gain=channel.sees_gain,
        gain_uncertainty=channel.gain_uncertainty or 0.0,
        delay_uncertainty=channel.delay_uncertainty or 0.0,
    )


def _half_thickness(channel: schema.Channel) -> float:
    """Distance of a gauge from the neutral axis [m]; 0 where a channel has none."""
    if channel.half_thickness is not None:
        return channel.half_thickness
    return _OF_A_CURVATURE if units.is_curvature(channel.unit) else 0.0


def _factor(name: str, channel: schema.Channel) -> float:
    return units.scale(name, channel.unit, _half_thickness(channel))


# Recordings


def _check_recordings(content: schema.CampaignFile, rig: Rig) -> None:
    # A file in both roles would be reported as a prediction although it was fitted.
    file, uses = Counter(os.path.normpath(entry.file) for entry in content.recordings).most_common(1)[0]
    if uses > 1:
        raise InputError(f"{schema.FILE}: recordings: {file} is listed {uses} times; expected each file once")
    for i, entry in enumerate(content.recordings, start=1):
        _check_file(f"{schema.FILE}: recordings[{i}].file", entry.file)
        if not {"hub_angle", "motor_angle"} & content.channels.keys() and not _may_be_absent(
            "hub_angle", entry
        ):
            raise InputError(
                f"{schema.FILE}: channels.hub_angle is missing; expected it for {entry.file}: "
                f"only a recording with clamped = true may lack it{_rate_is_no_angle(content)}"
            )
        check_deflection(f"{schema.FILE}: recordings[{i}] ({entry.file})", entry.initial_tip_deflection, rig)


def _rate_is_no_angle(content: schema.CampaignFile) -> str:
    return "; hub_rate does not replace it: its integral drifts" if "hub_rate" in content.channels else ""


def check_deflection(where: str, deflection: float | None, rig: Rig) -> None:
    """Raises InputError where an initial tip deflection [m] is not smaller than the link."""
    if deflection is not None and abs(deflection) >= rig["length"]:
        raise InputError(
            f"{where}.initial_tip_deflection is {deflection:g} m; "
            f"expected less than {rig['length']:g} m, the length of the link"
        )


def _check_file(where: str, file: str) -> None:
    """Raises InputError where a path leads out of the campaign's folder; links in the folder may."""
    path = PurePath(file)
    if path.anchor or ".." in path.parts:
        raise InputError(
            f"{where} is '{shown(file)}'; expected a file in the folder of the campaign: put it there, or a link to it"
        )


def _read_recording(
    root: Path, entry: schema.RecordingEntry, content: schema.CampaignFile, rig: Rig
) -> tuple[Recording, Table, list[str]]:
    """Returns the recording, the table from which it was read, and notes on its oddities."""
    channels = content.channels
    columns = {name: channel.column or name for name, channel in channels.items()}
    columns.setdefault(units.TIME, units.TIME)
    table = read_recording(root / entry.file, entry.file, set(columns.values()))
    unit = _factor(units.TIME, channels[units.TIME]) if units.TIME in channels else 1.0
    time = checked_time(table, columns[units.TIME], unit)
    present = {n: c for n, c in columns.items() if n != units.TIME and not _is_absent(n, c, table, entry)}
    values = {n: _si_values(n, channels[n], table.columns[c]) for n, c in present.items()}
    values, unused = derive(values, content.drive.gear_ratio, rig["length"])
    if not any(name in values for name in MEASURED):
        expected = [columns[name] for name in MEASURED if name in columns]
        raise InputError(f"{entry.file} has no measurement; expected a column: {', '.join(expected)}")
    values[_COMMAND], notes = _hold_command(values.get(_COMMAND), time, entry.file)
    values[_COMMAND] = values[_COMMAND] * torque_per_command(content.drive)
    notes += [f"{entry.file}: {name} is read and not used" for name in unused]
    recording = Recording(
        name=entry.file,
        time=time,
        channels=values,
        clamped=entry.clamped,
        loop=entry.loop,
        initial_tip_deflection=entry.initial_tip_deflection,
        start=entry.start,
        sampled=True,
    )
    return recording, table, notes + _similar_column_notes(columns, table)


def _is_absent(name: str, column: str, table: Table, entry: schema.RecordingEntry) -> bool:
    """Whether a recording lacks a channel that may be absent.

    Raises:
      InputError: the channel may not be absent, or its column is there and empty.
    """
    optional = _may_be_absent(name, entry)
    if column not in table.header:
        if name in ("hub_angle", _COMMAND) and not optional:
            raise InputError(
                f"{table.top}: column '{column}'{_channel_suffix(name, column)} is missing; "
                f"only a recording with clamped = true may lack it; the columns are: {listed(table.header)}"
                f"{nearest(column, table.header)}{table.note}"
            )
        return True
    if not np.isnan(table.columns[column]).all():
        return False
    if optional:
        return True
    raise InputError(
        f"{table.name}: {column}{_channel_suffix(name, column)} is missing in all {len(table)} samples; "
        "expected numbers, or a file without this column"
    )


def _channel_suffix(name: str, column: str) -> str:
    """Name of the channel in brackets, where its column has another name."""
    return "" if name == column else f" ({name})"


def _may_be_absent(name: str, entry: schema.RecordingEntry) -> bool:
    # A locked hub does not turn whatever its torque, and only a closed loop has a reference.
    if name in ("hub_angle", _COMMAND, "motor_torque"):
        return entry.clamped
    return name == "hub_reference" and entry.loop == "open"


def _si_values(name: str, channel: schema.Channel, raw: np.ndarray) -> np.ndarray:
    """Returns values (n) in SI units: gain * (raw - offset), converted from `unit` unless that is V or A."""
    gain = 1.0 if channel.gain is None else channel.gain
    return gain * (raw - channel.offset) * _factor(name, channel)


def _hold_command(command: np.ndarray | None, time: np.ndarray, file: str) -> tuple[np.ndarray, list[str]]:
    """Returns the command (n) without gaps, each value held until the next present one, and notes on gaps.

    Before the first present value, that value holds. Without a command column, the command is zero.
    """
    if command is None:
        return np.zeros_like(time), []
    missing = np.isnan(command)
    if not missing.any():
        return command, []
    last = np.maximum.accumulate(np.where(missing, 0, np.arange(len(command))))
    first = np.flatnonzero(~missing)[0]
    filled = command[np.maximum(last, first)]
    return filled, [f"{file}: {_COMMAND} is missing in {missing.sum()} samples; the value before is held"]


def _similar_column_notes(columns: Mapping[str, str], table: Table) -> list[str]:
    """Returns a note for every missing column where an unused one has a similar name."""
    unused = set(table.header) - set(columns.values())
    absent = [column for column in columns.values() if column not in table.header]
    hints = ((column, nearest(column, unused)) for column in absent)
    return [f"{table.name}: there is no column '{column}'{hint}" for column, hint in hints if hint]


def _check_columns(content: schema.CampaignFile, tables: list[Table]) -> None:
    """Raises InputError where no recording has the column of a declared channel."""
    present = set(chain.from_iterable(table.header for table in tables))
    for name, channel in content.channels.items():
        if (column := channel.column or name) not in present:
            raise InputError(
                f"{schema.FILE}: channels.{name}: no recording has a column '{column}'; "
                f"the columns are: {listed(sorted(present))}{nearest(column, present)}"
            )


def _read_static(root: Path, second_moment: float | None) -> StaticTest | None:
    if not os.path.lexists(root / STATIC_FILE):
        return None
    table = read_table(root / STATIC_FILE, STATIC_FILE)
    if not len(table):
        raise InputError(
            f"{STATIC_FILE} has no rows after its header; expected one per load, or no such file"
        )
    return StaticTest(table.columns, second_moment)


def _read_only(values: np.ndarray) -> np.ndarray:
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
