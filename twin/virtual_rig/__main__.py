"""`python -m twin.virtual_rig OUT`: generates a campaign of the virtual rig."""

import argparse
from collections.abc import Sequence

from twin.errors import InputError
from twin.terminal import BAD_INPUT, report_error, run
from twin.virtual_rig.campaign_writer import make_campaign
from twin.virtual_rig.effects import EFFECTS, OUTSIDE_EFFECTS
from twin.virtual_rig.sensors import DIRT


def parsed_effect(text: str) -> tuple[str, dict[str, float]]:
    """Returns name and parameters of `name:parameter=value,parameter=value`."""
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


def parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    result = argparse.ArgumentParser(prog="python -m twin.virtual_rig", description=__doc__)
    result.add_argument("out", help="folder to write the campaign into")
    result.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="NAME:PARAMETER=VALUE,...",
        help=f"undeclared effect, may be repeated; one of {', '.join(EFFECTS | OUTSIDE_EFFECTS)}",
    )
    result.add_argument("--seed", type=int, default=0)
    result.add_argument("--name", help="of the campaign; default, the folder's")
    result.add_argument(
        "--perturb",
        nargs="?",
        type=float,
        const=1.0,
        default=0.0,
        metavar="SHARE",
        help="true parameters off by this share of their declared uncertainty (1 if no share is given)",
    )
    result.add_argument("--dirty", action="append", default=[], choices=DIRT, help="may be repeated")
    result.add_argument("--no-motor-torque", action="store_true", help="leave the motor_torque channel out")
    result.add_argument("--truth", metavar="FILE", help="write effects and true parameters there, as JSON")
    result.add_argument("--force", action="store_true", help="write into a folder that is not empty")
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    """Generates the campaign; returns the exit code."""
    options = parser().parse_args(arguments)
    try:
        truth = make_campaign(
            options.out,
            dict(parsed_effect(text) for text in options.effect),
            options.seed,
            name=options.name,
            perturb=options.perturb,
            dirty=options.dirty,
            motor_torque=not options.no_motor_torque,
            truth_file=options.truth,
            force=options.force,
        )
    except InputError as error:
        report_error(str(error))
        return BAD_INPUT
    print(f"{options.out}: campaign '{truth.name}', effects: {', '.join(truth.effects) or 'none'}")
    return 0


if __name__ == "__main__":
    run(main)
