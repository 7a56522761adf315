"""Identification of a real rig, with its drive as declared, and with an additional declared speed law of the drive.

    python benchmarks/real_rigs.py CAMPAIGN [--viscous V]

The back-EMF of a voltage-driven motor brakes in proportion to speed. `--viscous` is its coefficient at the hub
[N m s/rad], with a standard error as large: it is declared as viscous friction, and identified with the rest.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from machine import command, describe

from twin.campaigns.campaign import Campaign, read_campaign
from twin.identification.estimates import Estimate
from twin.identification.identify import identify
from twin.identification.result import Identification
from twin.identification.text import format_estimate

LAW = "viscous-friction"


def answers(campaign: Campaign, viscous: float | None) -> dict[str, Identification]:
    """Returns description of the declared drive -> identification."""
    results = {"as declared": identify(campaign, workers=2)}
    if viscous is not None:
        law = {LAW: {"viscous": viscous}}
        results["with a speed law of its drive"] = identify(
            replace(campaign, effects=law, effect_errors=law), workers=2
        )
    return results


def table(result: dict[str, Identification]) -> str:
    """Returns a row for each quantity and a column for each identification, as Markdown."""
    columns = [dict(_quantities(f)) for f in result.values()]
    names = list(dict.fromkeys(name for column in columns for name in column))
    lines = ["| | " + " | ".join(result) + " |", "| --- " * (len(result) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(c.get(name, "-") for c in columns) + " |" for name in names]
    return "\n".join(lines)


def _quantities(result: Identification) -> Iterator[tuple[str, str]]:
    """Name and formatted value of each quantity."""
    for name, p in result.all_parameters.items():
        for method, value in p.methods.items():
            yield f"{name} [{p.unit}], {method}", format_estimate(value)
    for q in result.derived:
        value = format_estimate(q.estimate) if q.estimate.informative else "not determined"
        yield f"{q.label} [{q.unit}]", value
    for decay in result.procedures.decays:
        yield f"clamped, {decay.recording} [Hz]", format_estimate(decay.frequency)
        yield f"damping ratio, {decay.recording}", format_estimate(decay.damping_ratio)
    if result.procedures.static_test is not None:
        yield (
            "static test",
            _static(result.procedures.static_test.stiffness, result.procedures.static_test.curvature),
        )
    yield "held out: hub in windows, noise levels", _median_error(result, "windowed", "hub_angle")
    yield (
        "held out: base strain under the measured hub, noise levels",
        _median_error(result, "by_steps", "strain_base"),
    )
    yield "time [s]", f"{result.wall_s:.0f}"


def _static(stiffness: Estimate | None, curvature: Estimate | None) -> str:
    if stiffness is not None:
        return f"EI = {format_estimate(stiffness, 'N*m^2')}"
    return "-" if curvature is None else f"{format_estimate(curvature, '1/m')} for one unit of the gauge"


def _median_error(result: Identification, error: str, channel: str) -> str:
    sizes = [getattr(e, error) / e.noise for e in result.held_out if e.channel == channel]
    return f"{np.median(sizes):.3g}" if sizes else "-"


def main() -> None:
    """Identifies the rig and prints the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--viscous", type=float, metavar="V", help="speed law of the drive [N m s/rad]")
    options = parser.parse_args()
    if options.viscous is not None and not 0 < options.viscous < math.inf:
        parser.error(f"--viscous is {options.viscous}; expected a number above 0")
    result = answers(read_campaign(options.campaign), options.viscous)
    print(f"`{command()}`, {describe()}\n")
    print(table(result))
    for name, answer in result.items():
        print(f"\n{name[0].upper()}{name[1:]}:\n")
        print("\n".join(f"- {s}" for f in answer.findings for s in f.sentences))


if __name__ == "__main__":
    main()
