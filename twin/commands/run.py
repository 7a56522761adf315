"""`twin run`: one experiment, simulated on one of the plants."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin.commands.shared import (
    CONTROLLER_NAMES,
    CONTROLLERS,
    DEFAULT_RIG,
    PLANT_NAMES,
    SCENARIO_NAMES,
    JsonFile,
    RigOption,
    completed,
    console,
    controller_file,
    load_rig,
    progress,
    require_display,
    rig_file,
)
from twin.errors import InputError
from twin.files.json import write_json
from twin.files.outputs import check_writable

if TYPE_CHECKING:
    from twin.control.closed_loop import Run
    from twin.control.experiment import Experiment
    from twin.rigs.patch import Patch

Scenario = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="bang-bang-20, -45, -60, -90 or -120; sinus-0.2 or -0.4; filtered-step-120; lq-step-120.",
        autocompletion=completed(SCENARIO_NAMES),
    ),
]
PlantOption = Annotated[
    str,
    typer.Option(
        "--plant",
        metavar="NAME",
        help="chain (MuJoCo), compiled (the same chain), modal (n modes), or paper (its one mode and friction); "
        "the last two without backlash.",
        autocompletion=completed(PLANT_NAMES),
    ),
]
ControllerOption = Annotated[
    str | None,
    typer.Option(
        "--controller",
        metavar="NAME|FILE.py:NAME",
        help=CONTROLLERS,
        show_default="the scenario's own",
        autocompletion=completed(CONTROLLER_NAMES),
    ),
]
Noise = Annotated[
    int | None,
    typer.Option(
        "--seed",
        "--noise",
        metavar="SEED",
        help="Simulate noise and resolution of the sensors, with this seed.",
        min=0,
        show_default="none",
    ),
]


def run(
    scenario: Scenario,
    plant: PlantOption = "chain",
    controller: ControllerOption = None,
    rig: RigOption = DEFAULT_RIG,
    noise: Noise = None,
    patch_file: Annotated[
        Path | None,
        typer.Option(
            "--patch", metavar="FILE", help="Add a lookup table to the plant: the patch.csv of a diagnosis."
        ),
    ] = None,
    rrd_file: Annotated[
        Path | None, typer.Option("--rrd", metavar="FILE", help="Write the run here as a rerun file.")
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Show the run in the rerun viewer while it is computed.")
    ] = False,
    ghost: Annotated[
        str | None,
        typer.Option(
            metavar="other|none|FILE",
            help="Second arm with --rrd or --view: the other plant, none, or a recording.",
            show_default="other",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "--csv",
            metavar="FILE",
            help="Write the run here as a recording: .csv, .mat, .parquet or .mcap.",
        ),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Simulate one of the paper's experiments with a controller on the chain, the modal or the paper's model."""
    read = (rig_file(rig), controller_file(controller), patch_file, *_ghost_files(ghost or ""))
    check_writable(out, json_file, rrd_file, read=read)
    _check_table(out)
    if ghost is not None and rrd_file is None and not view:
        raise InputError("--ghost is shown beside a run; expected --rrd FILE or --view with it")
    declared, effects = load_rig(rig)
    patch = None if patch_file is None else _patch(patch_file)
    if view:
        require_display("--view")
    remarks: list[str] = []
    with progress() as report:
        report("loading the plants")
        from twin.control.experiment import Experiment
        from twin.control.plants import KINDS
        from twin.report.show_run import run_and_show

        experiment = Experiment(scenario, plant, declared, effects, controller, noise, patch)
        report(f"{scenario} on the {KINDS.get(plant, plant)}")
        result = run_and_show(experiment, rrd_file, view, ghost or "other", remarks.append)
    answer = _answer(experiment, result)
    if out is not None:
        from twin.report.run_files import write_run

        write_run(result, out)
    if json_file is not None:
        write_json(json_file, answer)
    _print(answer)
    for line in remarks:
        console().print(line)
    for what, path in (("run", out), ("rerun", rrd_file), ("JSON", json_file)):
        if path is not None:
            console().print(f"{what:<6}  {path}", soft_wrap=True)


def _answer(experiment: Experiment, result: Run) -> dict[str, Any]:
    """The result as plain values for JSON."""
    answer = {
        "scenario": experiment.scenario,
        "plant": experiment.plant,
        "controller": experiment.controller_name,
        "duration_s": float(result.time[-1]),
        "wall_s": result.wall,
        "metrics": experiment.metrics(result),
    }
    if experiment.patch is not None:
        answer["patch"] = f"{experiment.patch.channel} by {experiment.patch.variable}"
    return answer


def _check_table(path: Path | None) -> None:
    from twin.files.writers import check_table

    check_table(path)


def _patch(file: Path) -> Patch:
    from twin.rigs import patch

    return patch.read_patch(file)


def _ghost_files(ghost: str) -> tuple[Path, ...]:
    """The files that a ghost is read from; none unless it is a file."""
    from twin.report.run_files import files_read, is_file_of_run

    return files_read(Path(ghost)) if is_file_of_run(ghost) else ()


def _print(answer: dict[str, Any]) -> None:
    from rich.table import Table

    from twin import labels
    from twin.control.plants import KINDS
    from twin.report.prose import prose

    screen = console()
    speed = answer["duration_s"] / answer["wall_s"]
    screen.print(
        f"{answer['scenario']} on the {KINDS[answer['plant']]}, controller {answer['controller']}: "
        f"{answer['duration_s']:g} s in {answer['wall_s']:.2f} s, {speed:.0f} times real time",
        highlight=False,
    )
    if "patch" in answer:
        screen.print(f"With a patch, which is no physics: {prose(answer['patch'])}")
    table = Table("figure", "value", "unit", box=None)
    table.columns[1].justify = "right"
    for name, value in answer["metrics"].items():
        shown = labels.METRICS[name]
        table.add_row(shown.label, labels.number(shown.factor * value, labels.PAGE_DIGITS), shown.unit)
    screen.print(table)
