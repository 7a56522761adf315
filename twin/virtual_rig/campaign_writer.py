"""Writes campaigns: a folder of CSV files and a campaign.toml that declares the rig, but not its effects."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from twin.errors import InputError, checked_count, checked_number
from twin.files.whole import check_file, check_folder, is_temporary, write_files, writing
from twin.virtual_rig.beam import Array, basis_of, build_link
from twin.virtual_rig.effects import switch_on
from twin.virtual_rig.experiments import HUB_RANGE, Experiment, planned_campaign, run_experiment
from twin.virtual_rig.rig import UNCERTAINTY, Rig, declared_values, with_declared
from twin.virtual_rig.sensors import (
    Sensed,
    Sensors,
    checked_dirt,
    noise_of,
    readings,
    sample_times,
    sensed,
    soiled,
)

# Decimals of each channel in the CSV files.
DECIMALS = {
    "time": 5,
    "torque_command": 5,
    "motor_torque": 5,
    "hub_reference": 6,
    "hub_angle": 5,
    "strain_base": 8,
    "strain_mid": 8,
}


@dataclass(frozen=True)
class Truth:
    """What a campaign does not declare: the effects, the true parameters and the defects of its data."""

    name: str
    seed: int
    effects: dict[str, dict[str, float]]
    declared: dict[str, float]  # as in campaign.toml, SI units
    true: dict[str, float]  # true values of the same parameters, without the effects
    defects: dict[str, dict[str, list[float]]]  # file -> kind -> times [s]

    def to_text(self) -> str:
        """Returns the truth as JSON."""
        return json.dumps(asdict(self), indent=2) + "\n"


Engine = Callable[[Rig, Sensors, Experiment, Array, Array], Sensed]
"""Simulates an experiment: true rig, data acquisition, plan, sample times (samples,) [s], noise of the hub sensor
(samples,) [rad] -> what the sensors are exposed to."""


def ritz_engine(rig: Rig, sensors: Sensors, plan: Experiment, times: Array, hub_noise: Array) -> Sensed:
    """The engine of this package, see `beam` and `plant`."""
    link = build_link(rig, *basis_of(rig))
    return sensed(rig, link, sensors, run_experiment(rig, link, sensors, plan, times, hub_noise))


_LARGEST_SEED = 2**128 - 1  # of numpy's generators
_LARGEST_SHARE = 4.0
"""Largest factor on the declared uncertainty of at most 10 %: two standard deviations leave parameters positive."""


def make_campaign(
    folder: Path | str,
    effects: Mapping[str, Mapping[str, float]],
    seed: int,
    *,
    name: str | None = None,
    rig: Rig | None = None,
    sensors: Sensors | None = None,
    experiments: Sequence[Experiment] | None = None,
    perturb: float = 0.0,
    dirty: Iterable[str] = (),
    motor_torque: bool = True,
    truth_file: Path | str | None = None,
    force: bool = False,
    engine: Engine = ritz_engine,
) -> Truth:
    """Generates a campaign of a rig with undeclared effects and returns what it does not declare.

    Args:
        folder: Where to write; created if necessary.
        effects: Effects by name with their parameters, see `effects`.
        seed: Of all random numbers; the same seed gives the same files.
        name: Of the campaign; default, the folder's.
        rig: The declared rig; default, the neutral `Rig()`.
        sensors: The data acquisition; default, 500 Hz.
        experiments: The experiments; default, a random plan of eight recordings.
        perturb: Standard deviation of the true parameters about the declared ones, over their uncertainty.
        dirty: Kinds of defects in the data, see `sensors.DIRT`.
        motor_torque: Whether the motor torque is measured.
        truth_file: Where to write the truth as JSON, outside `folder`.
        force: Whether to write into a folder that is not empty.
        engine: What simulates the experiments; default, that of this package.

    Raises:
        InputError: for unknown effects or defects, numbers that cannot be, a folder that is not empty, a truth file
            inside it, or files that cannot be written.
    """
    folder = Path(folder)
    checked_count("seed", seed, 0, _LARGEST_SEED)
    checked_number("perturb", perturb, 0.0, _LARGEST_SHARE)
    kinds = checked_dirt(dirty)
    _check_places(folder, truth_file, force)
    declared_rig = rig or Rig()
    card = sensors or Sensors()
    actual = _perturbed(declared_rig, perturb, np.random.default_rng([seed, 1]))
    true_rig = switch_on(actual, effects)
    plans = experiments or planned_campaign(declared_rig, card, np.random.default_rng([seed, 2]))

    files: dict[Path, str] = {}
    defects = {}
    for number, plan in enumerate(plans):
        table = _record(engine, true_rig, card, plan, kinds, np.random.default_rng([seed, 3, number]))
        table, found = soiled(table, card, kinds, np.random.default_rng([seed, 4, number]))
        if not motor_torque:
            table.pop("motor_torque", None)
        files[folder / f"{plan.name}.csv"] = to_csv(table)
        if found:
            defects[f"{plan.name}.csv"] = found
    title = name or folder.resolve().name

    truth = Truth(
        name=title,
        seed=seed,
        effects={effect: dict(values) for effect, values in effects.items()},
        declared=declared_values(declared_rig),
        true=declared_values(actual),
        defects=defects,
    )
    if truth_file is not None:
        files[Path(truth_file)] = truth.to_text()
    # Last: without it the folder is no campaign.
    files[folder / "campaign.toml"] = _campaign_toml(title, declared_rig, card, plans, motor_torque)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_files(files)
    return truth


def _check_places(folder: Path, truth_file: Path | str | None, force: bool) -> None:
    """Raises InputError if a campaign would be overwritten, or the truth written inside one."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; expected a folder to write a campaign into.")
    check_folder(folder)
    if folder.is_dir() and any(not is_temporary(path.name) for path in folder.iterdir()) and not force:
        raise InputError(f"{folder} is not empty; give another folder, or --force to write into this one.")
    if truth_file is not None and folder.resolve() in Path(truth_file).resolve().parents:
        raise InputError(
            f"truth file is {truth_file}, inside the campaign; expected a place outside {folder}."
        )
    if truth_file is not None:
        check_file(Path(truth_file))


def _perturbed(rig: Rig, share: float, generator: np.random.Generator) -> Rig:
    """Returns the rig with normal errors of `share` of the uncertainty, truncated at two standard deviations."""
    draws = np.clip(generator.standard_normal(len(UNCERTAINTY)), -2.0, 2.0)
    values = declared_values(rig)
    changed = {
        name: values[name] * (1 + share * sigma * draw)
        for (name, sigma), draw in zip(UNCERTAINTY.items(), draws, strict=True)
    }
    return with_declared(rig, changed) if share else rig


def _record(
    engine: Engine,
    rig: Rig,
    sensors: Sensors,
    plan: Experiment,
    kinds: Iterable[str],
    generator: np.random.Generator,
) -> dict[str, Array]:
    """Returns the columns of one recording (samples,) by channel name."""
    if rig.knock_torque:
        rig = rig._replace(knock_phase=generator.uniform(0.0, 2 * np.pi))
    times = sample_times(sensors, len(plan.commands), kinds, generator)
    noise = noise_of(sensors, len(times), generator)
    true = engine(rig, sensors, plan, times, noise["hub_angle"])
    table = {"time": times, "torque_command": true.commands}
    if plan.reference is not None:
        table["hub_reference"] = plan.reference
    channels = readings(rig, sensors, times, true, noise)
    kept = _within_range(true.hub_angle)
    if plan.clamped:
        # The hub of the locked rig does not turn and its motor is off.
        channels = {name: channels[name] for name in ("strain_base", "strain_mid")}
    return {name: column[:kept] for name, column in (table | channels).items()}


def _within_range(angle: Array) -> int:
    """Returns the number of samples of a hub angle (samples,) [rad] before it leaves the sensor's range."""
    outside = np.abs(angle) > HUB_RANGE
    return int(np.argmax(outside)) if outside.any() else len(angle)


def to_csv(table: Mapping[str, Array], decimals: Mapping[str, int] = DECIMALS) -> str:
    """Returns the columns as CSV with fixed decimals by column; a missing sample is an empty field."""
    formats = [f"%.{decimals[name]}f" for name in table]
    rows = (
        ",".join("" if value != value else form % value for form, value in zip(formats, row, strict=True))
        for row in zip(*(column.tolist() for column in table.values()), strict=True)
    )
    return "\n".join([",".join(table), *rows]) + "\n"


def _campaign_toml(
    name: str, rig: Rig, sensors: Sensors, plans: Sequence[Experiment], motor_torque: bool
) -> str:
    """Returns the text of campaign.toml."""
    lines = [
        "# A campaign on the virtual rig (twin virtual-rig).",
        "format = 1",
        f"name = {json.dumps(name, ensure_ascii=False)}",
        'rig = "bossi2009"',
        "",
        "[parameters]",
    ]
    lines += [f"{parameter} = {value:.10g}" for parameter, value in declared_values(rig).items()]
    lines += ["", "[uncertainty]"]
    lines += [f"{parameter} = {sigma:g}" for parameter, sigma in UNCERTAINTY.items()]
    gauge = f"half_thickness = {sensors.half_thickness:g}"
    lines += _channel("hub_angle", "rad", sensors.hub_noise)
    lines += _channel("strain_base", "1", sensors.strain_noise)
    lines += [f"position = {sensors.position_base:g}", gauge]
    lines += _channel("strain_mid", "1", sensors.strain_noise)
    lines += [f"position = {sensors.position_mid:g}", gauge]
    if motor_torque:
        lines += _channel("motor_torque", "N*m", sensors.torque_noise)
    lines += _channel("torque_command", "N*m")
    if any(plan.reference is not None for plan in plans):
        lines += _channel("hub_reference", "rad")
    for plan in plans:
        lines += _recording(plan)
    return "\n".join(lines) + "\n"


def _channel(name: str, unit: str, noise: float | None = None) -> list[str]:
    """Returns the lines of one channel's table."""
    lines = ["", f"[channels.{name}]", f'unit = "{unit}"']
    return lines if noise is None else [*lines, f"noise = {noise:g}"]


def _recording(plan: Experiment) -> list[str]:
    """Returns the lines of one recording's table."""
    lines = [
        "",
        "[[recordings]]",
        f'file = "{plan.name}.csv"',
        f'experiment = "{plan.label}"',
        f"clamped = {str(plan.clamped).lower()}",
        f'loop = "{"open" if plan.reference is None else "closed"}"',
        f'role = "{plan.role}"',
    ]
    if plan.tip_deflection is not None:
        lines.append(f"initial_tip_deflection = {plan.tip_deflection:g}")
    return lines
