"""`twin virtual-rig`: a campaign of the virtual rig, with effects that it does not declare."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin.commands.shared import Force, console, progress
from twin.errors import InputError


def virtual_rig(
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Folder of the campaign.")],
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME:PARAMETER=VALUE,...",
            help="Undeclared effect, may be repeated; what is not said of one is usual.",
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(metavar="SEED", help="Seed of commands, noise and true parameters.", min=0)
    ] = 0,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of the campaign.", show_default="the folder's")
    ] = None,
    perturb: Annotated[
        float,
        typer.Option(
            metavar="SHARE", help="True parameters off by this share of their declared uncertainty."
        ),
    ] = 0.0,
    dirty: Annotated[
        list[str] | None,
        typer.Option(
            metavar="DEFECT",
            help="missing-fields, spikes, dropped-rows, jitter, stuck, saturated or bad-segment; may be repeated.",
        ),
    ] = None,
    no_motor_torque: Annotated[
        bool, typer.Option("--no-motor-torque", help="Leave the channel motor_torque out.")
    ] = False,
    truth: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write effects and true parameters here, as JSON."),
    ] = None,
    force: Force = False,
) -> None:
    """Generate a campaign of a virtual rig with effects that it does not declare, to try the twin on."""
    effects = dict(parsed_effect(text) for text in effect or ())
    with progress() as report:
        report("simulating the experiments")
        from twin.virtual_rig import make_campaign

        made = make_campaign(
            out,
            effects,
            seed,
            name=name,
            perturb=perturb,
            dirty=dirty or (),
            motor_torque=not no_motor_torque,
            truth_file=truth,
            force=force,
        )
    shown = ", ".join(made.effects) or "none"
    console().print(f"{out}: campaign '{made.name}', effects: {shown}", soft_wrap=True)


def parsed_effect(text: str) -> tuple[str, dict[str, float]]:
    """Returns name and parameters of `name:parameter=value,parameter=value`.

    Raises:
      InputError: a value is no number.
    """
    name, _, rest = text.partition(":")
    parameters = {}
    for item in filter(None, rest.split(",")):
        key, equals, value = item.partition("=")
        try:
            parameters[key.strip()] = float(value)
        except ValueError:
            shown = f"{key}={value}" if equals else key
            raise InputError(f"--effect {name}: '{shown}' given; expected parameter=number.") from None
    return name, parameters
