"""`twin view`: a controlled rig in MuJoCo's interactive viewer, in real time."""

from __future__ import annotations

from typing import Annotated

import typer

from twin.commands.run import ControllerOption
from twin.commands.shared import DEFAULT_RIG, RigOption, load_rig, require_display


def view(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="A scenario of `twin run`.")
    ] = "lq-step-120",
    controller: ControllerOption = None,
    rig: RigOption = DEFAULT_RIG,
) -> None:
    """Show a controller on the chain in MuJoCo's interactive viewer, in real time."""
    declared, effects = load_rig(rig)
    require_display("twin view")
    import mujoco.viewer

    from twin.control.experiment import Experiment
    from twin.report.mujoco_viewer import watch

    watch(Experiment(scenario, "chain", declared, effects, controller), mujoco.viewer.launch_passive)
