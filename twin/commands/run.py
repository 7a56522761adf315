"""`twin run`: one experiment on either plant."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin.commands.shared import JsonFile, RigOption, check_writable, console, load_rig, progress
from twin.json_file import write_json

if TYPE_CHECKING:
    from twin.closed_loop import Run

Scenario = Annotated[
    str,
    typer.Argument(
        help="bang-bang-20, -45, -60, -90 or -120; sinus-0.2 or -0.4; filtered-step-120; lq-step-120."
    ),
]
PlantOption = Annotated[str, typer.Option("--plant", help="chain (MuJoCo) or modal.")]
ControllerOption = Annotated[
    str | None,
    typer.Option(
        "--controller",
        metavar="NAME|FILE.py:NAME",
        help="siso, lqi, lqi-zv, lqi-ei, siso-friction, or one of yours.",
        show_default="the scenario's own",
    ),
]
Noise = Annotated[
    int | None,
    typer.Option(
        "--noise", metavar="SEED", help="Noise and resolution of the rig's sensors.", show_default="none"
    ),
]


def run(
    scenario: Scenario,
    plant: PlantOption = "chain",
    controller: ControllerOption = None,
    rig: RigOption = "bossi2009",
    noise: Noise = None,
    csv_file: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write the run here, as a recording.")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Run one of the paper's experiments on the chain or the modal model, under any controller."""
    check_writable(csv_file, json_file)
    declared, effects = load_rig(rig)
    with progress() as report:
        report("building the plant")
        result, name, figures = _run(scenario, plant, controller, declared, effects, noise, report)
    answer = {
        "scenario": scenario,
        "plant": plant,
        "controller": name,
        "duration_s": float(result.time[-1]),
        "wall_s": result.wall,
        "metrics": figures,
    }
    if csv_file is not None:
        from twin.run_files import write_csv

        write_csv(result, csv_file)
    if json_file is not None:
        write_json(json_file, answer)
    _print(answer)


def _run(scenario, plant, controller, rig, effects, noise, report) -> tuple[Run, str, dict[str, float]]:
    from twin import closed_loop, plants, scenarios
    from twin.control import library
    from twin.plants.sensors import BOSSI2009, Sensors

    chosen = scenarios.scenario(scenario)
    built = plants.make(plant, rig, effects)
    if controller is None:
        law = chosen.own_controller(rig, built.period)
    else:
        law = library.controller(controller, rig, built.period)
    report(f"{scenario} on the {plant}")
    sensors = None if noise is None else Sensors(BOSSI2009, noise)
    result = closed_loop.run(built, law, chosen.reference, chosen.duration, sensors)
    return result, controller or chosen.controller, scenarios.metrics(result, chosen.from_half)


def _print(answer: dict[str, Any]) -> None:
    from rich.table import Table

    screen = console()
    speed = answer["duration_s"] / answer["wall_s"]
    screen.print(
        f"{answer['scenario']} on the {answer['plant']}, controller {answer['controller']}: "
        f"{answer['duration_s']:g} s in {answer['wall_s']:.2f} s, {speed:.0f} times real time",
        highlight=False,
    )
    table = Table("figure", "value", box=None)
    table.columns[1].justify = "right"
    for name, value in answer["metrics"].items():
        table.add_row(name, f"{value:.4g}")
    screen.print(table, highlight=False)
