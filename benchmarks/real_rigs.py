"""What an identification says of a real rig, its drive taken as it is declared, and with a speed law that is known.

    python benchmarks/real_rigs.py CAMPAIGN [--viscous V]

A motor that is driven by a voltage brakes itself in proportion to its speed. `--viscous` is what this comes to at the
hub [N m s/rad], known to a factor: it is declared as a viscous friction, and identified with the rest.
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
    """What was known of the drive -> what was found."""
    found = {"as declared": identify(campaign, workers=2)}
    if viscous is not None:
        law = {LAW: {"viscous": viscous}}
        found["with a speed law of its drive"] = identify(
            replace(campaign, effects=law, effect_errors=law), workers=2
        )
    return found


def table(found: dict[str, Identification]) -> str:
    """Each quantity as each answer has it, as Markdown."""
    columns = [dict(_quantities(f)) for f in found.values()]
    names = list(dict.fromkeys(name for column in columns for name in column))
    lines = ["| | " + " | ".join(found) + " |", "| --- " * (len(found) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(c.get(name, "-") for c in columns) + " |" for name in names]
    return "\n".join(lines)


def _quantities(found: Identification) -> Iterator[tuple[str, str]]:
    for name, p in found.all_parameters.items():
        for method, value in p.methods.items():
            yield f"{name} [{p.unit}], {method}", format_estimate(value)
    for q in found.derived:
        value = format_estimate(q.estimate) if q.estimate.informative else "not determined"
        yield f"{q.label} [{q.unit}]", value
    for decay in found.procedures.decays:
        yield f"clamped, {decay.recording} [Hz]", format_estimate(decay.frequency)
        yield f"damping ratio, {decay.recording}", format_estimate(decay.damping_ratio)
    if found.procedures.static_test is not None:
        yield (
            "static test",
            _static(found.procedures.static_test.stiffness, found.procedures.static_test.curvature),
        )
    yield "held out: hub in windows, noise levels", _middle(found, "windowed", "hub_angle")
    yield (
        "held out: base strain under the measured hub, noise levels",
        _middle(found, "by_steps", "strain_base"),
    )
    yield "time [s]", f"{found.wall_s:.0f}"


def _static(stiffness: Estimate | None, curvature: Estimate | None) -> str:
    if stiffness is not None:
        return f"EI = {format_estimate(stiffness, 'N m^2')}"
    return "-" if curvature is None else f"{format_estimate(curvature, '1/m')} for one unit of the gauge"


def _middle(found: Identification, error: str, channel: str) -> str:
    sizes = [getattr(e, error) / e.noise for e in found.held_out if e.channel == channel]
    return f"{np.median(sizes):.3g}" if sizes else "-"


def main() -> None:
    """Identifies the rig and prints what was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--viscous", type=float, metavar="V", help="speed law of the drive [N m s/rad]")
    options = parser.parse_args()
    if options.viscous is not None and not 0 < options.viscous < math.inf:
        parser.error(f"--viscous is {options.viscous}; expected a number above 0")
    found = answers(read_campaign(options.campaign), options.viscous)
    print(f"`{command()}`, {describe()}\n")
    print(table(found))
    for name, answer in found.items():
        print(f"\n{name[0].upper()}{name[1:]}:\n")
        print("\n".join(f"- {s}" for f in answer.findings for s in f.sentences))


if __name__ == "__main__":
    main()
