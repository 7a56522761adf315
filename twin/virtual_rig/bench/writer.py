"""Draws a bench by its seed and writes its campaign: CSV files and campaign.toml, without the effects."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from twin.errors import checked_count
from twin.files.whole import write_files, writing
from twin.virtual_rig.bench.commands import Desk, Run, closed_loop_runs, drawn_controller, open_loop_runs
from twin.virtual_rig.bench.kinds import Effects, drawn_effects, kind_of, log_uniform, missing_of
from twin.virtual_rig.bench.recording import Bench, Recorded, record, repeatability, visibility
from twin.virtual_rig.bench.ruler import UNCERTAINTY, declared_rig, drawn_rig
from twin.virtual_rig.bench.sensors import GAUGE_POSITION, BenchSensors, drawn_sensors
from twin.virtual_rig.campaign_writer import to_csv
from twin.virtual_rig.effects import switch_on
from twin.virtual_rig.rig import declared_values

LEAST_VISIBLE = 3.0
"""Noise levels by which each effect has to change a held-out recording; a bench on which it does not is drawn again."""
_LEAST_COMPLETE = 0.6
"""Share of a recording before the hub has travelled too far, else it is repeated with less voltage."""
_DURATIONS = (10.0, 20.0)  # s, of the recordings
_MOST_TRIES = 50  # benches of a seed, and repetitions of a recording
_LARGEST_SEED = 2**64 - 1
_DECIMALS = {"time": 3, "motor_voltage": 4, "pot": 5, "link": 5}


@dataclass(frozen=True)
class BenchTruth:
    """What the campaign of a bench does not declare.

    Attributes:
        name, seed: Of the bench.
        kind: Of `kinds.PATTERN`.
        effects: Undeclared effects with their parameters.
        declared, true: Parameters of the rig, SI; true ones in units of the declared torque.
        closed_loop: Whether the recordings to fit are under feedback.
        sample_rate: [Hz].
        visible: Effect -> largest change of a held-out recording in windows of 1 s, in noise levels.
        noise: Channel -> standard deviation of noise and quantisation, SI.
        repeatability: Held-out file -> channel -> change by 0.1 % of the static friction, SI.
    """

    name: str
    seed: int
    kind: str
    effects: Effects
    declared: dict[str, float]
    true: dict[str, float]
    closed_loop: bool
    sample_rate: float
    visible: dict[str, float]
    noise: dict[str, float]
    repeatability: dict[str, dict[str, float]]

    def to_text(self) -> str:
        """Returns the truth as JSON."""
        return json.dumps(asdict(self), indent=2) + "\n"


def make_bench(folder: Path | str, seed: int, truth_file: Path | str | None = None) -> BenchTruth:
    """Generates the campaign of the bench of a seed and returns what it does not declare.

    Args:
        folder: Where to write; files of the same names are replaced.
        seed: Decides the kind of bench and all random numbers.
        truth_file: Where to write the truth as JSON, outside `folder`.

    Raises:
        InputError: for a seed that is no whole number from 0, or files that cannot be written.
    """
    checked_count("seed", seed, 0, _LARGEST_SEED)
    folder = Path(folder)
    bench, recordings, visible, declared = _visible_bench(seed)
    held_out = [r for r in recordings if r.run.role == "holdout"]
    closed = any(r.run.reference is not None for r in recordings)
    name = f"bench-{seed}"
    truth = BenchTruth(
        name=name,
        seed=seed,
        kind=kind_of(seed),
        effects=bench.effects,
        declared=declared,
        true=declared_values(bench.base),
        closed_loop=closed,
        sample_rate=bench.sensors.sample_rate,
        visible=visible,
        noise=bench.sensors.noise_levels(),
        repeatability={_file(r.run): repeatability(bench, r) for r in held_out},
    )
    files = {folder / _file(r.run): to_csv(r.columns, _DECIMALS) for r in recordings}
    if truth_file is not None:
        files[Path(truth_file)] = truth.to_text()
    # Last: without it the folder is no campaign.
    files[folder / "campaign.toml"] = _campaign_toml(name, bench, declared, [r.run for r in recordings])
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_files(files)
    return truth


def _visible_bench(seed: int) -> tuple[Bench, list[Recorded], dict[str, float], dict[str, float]]:
    """Returns the first bench of a seed on which every effect is visible, its recordings and what it declares."""
    for attempt in range(_MOST_TRIES):
        generator = np.random.default_rng([seed, attempt])
        bench, declared, runs = _drawn_bench(seed, generator)
        held_out = [_recorded(bench, run, generator) for run in runs if run.role == "holdout"]
        visible = {name: max(visibility(bench, r, name) for r in held_out) for name in bench.effects}
        if all(levels >= LEAST_VISIBLE for levels in visible.values()):
            fitted = [_recorded(bench, run, generator) for run in runs if run.role == "fit"]
            return bench, [*fitted, *held_out], visible, declared
    raise RuntimeError(f"no bench of seed {seed} shows its effects in {_MOST_TRIES} draws")


def _drawn_bench(seed: int, generator: np.random.Generator) -> tuple[Bench, dict[str, float], list[Run]]:
    """Returns a random bench with the effects of a seed, what it declares, and its plan."""
    names = missing_of(seed)
    effects = drawn_effects(names, generator)
    torque_per_volt = float(f"{generator.uniform(0.1, 0.15):.4g}")
    base = drawn_rig(effects, torque_per_volt, generator)
    closed = bool(generator.random() < 0.35)
    sensors = drawn_sensors(base, closed, generator)
    desk = Desk(
        switch_on(base, effects), torque_per_volt, sensors.sample_rate, log_uniform(*_DURATIONS, generator)
    )
    bench = Bench(base, effects, torque_per_volt, sensors, drawn_controller(desk, generator))
    runs = closed_loop_runs(desk, generator) if closed else open_loop_runs(desk, generator)
    return bench, declared_rig(base, generator), runs


def _recorded(bench: Bench, run: Run, generator: np.random.Generator) -> Recorded:
    """Returns a run on the bench; repeated with less voltage while the hub travels too far."""
    for _ in range(_MOST_TRIES):
        recorded = record(bench, run, generator)
        if recorded.completeness >= _LEAST_COMPLETE:
            break
        run = replace(run, volts=0.9 * run.volts)
    return recorded


def _file(run: Run) -> str:
    return f"{run.name}.csv"


def _campaign_toml(name: str, bench: Bench, declared: Mapping[str, float], runs: Sequence[Run]) -> str:
    """Returns the text of campaign.toml."""
    lines = ["# A virtual bench.", "format = 1", f'name = "{name}"', f'rig = "{name}"', "", "[parameters]"]
    lines += [f"{parameter} = {value:.10g}" for parameter, value in declared.items()]
    lines += ["", "[uncertainty]"]
    lines += [f"{parameter} = {sigma:g}" for parameter, sigma in UNCERTAINTY.items() if declared[parameter]]
    lines += _channel("torque_command", "motor_voltage", "V")
    lines += [f"gain = {bench.torque_per_volt:.10g}"]
    lines += _channel("hub_angle", "pot", "rad")
    lines += _link_channel(bench.sensors)
    for run in runs:
        lines += _recording(run)
    return "\n".join(lines) + "\n"


def _channel(name: str, column: str, unit: str) -> list[str]:
    return ["", f"[channels.{name}]", f'column = "{column}"', f'unit = "{unit}"']


def _link_channel(sensors: BenchSensors) -> list[str]:
    """Returns the lines of the gauge, calibrated in curvature, or of the tip sensor."""
    if sensors.link_channel == "tip_deflection":
        return _channel(sensors.link_channel, "link", "mm")
    gauge = [f"gain = {sensors.link_gain:.10g}", f"position = {GAUGE_POSITION:g}", "half_thickness = 1.0"]
    return [*_channel(sensors.link_channel, "link", "V"), *gauge]


def _recording(run: Run) -> list[str]:
    """Returns the lines of one recording's table."""
    lines = ["", "[[recordings]]", f'file = "{_file(run)}"', f'role = "{run.role}"']
    lines.append(f'loop = "{"open" if run.reference is None else "closed"}"')
    return [*lines, 'start = "unknown"'] if run.lead else lines
