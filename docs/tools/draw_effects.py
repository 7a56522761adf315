"""Draws what each effect does to one experiment: docs/pictures/effects/NAME.svg.

python docs/tools/draw_effects.py

The experiment is a slew to one side and back of the rig `bossi2009` with a smaller static friction, so that it is the
effect that shows and not one stick more or less; the sizes are those of tests/planted.py. The colours are visible on
light and dark pages alike.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from drawing import PICTURES
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import twin
from twin import labels
from twin.effects import REGISTRY

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from planted import PLANTED  # noqa: E402

TIME = np.arange(0.0, 4.0, 2e-3)  # s
PULSES = ((0.2, 0.15), (0.55, -0.15), (0.9, 0.0), (2.2, -0.15), (2.55, 0.15), (2.9, 0.0))  # s, N m
CHANNELS = ("hub_angle", "strain_base")
STATIC_FRICTION = 0.015  # N m, for the 0.065 of `bossi2009`
SHOWN = 4  # every fourth sample
GREY, BLUE = "#848d97", "#2b8ccd"
STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "flexlink-twin",
    "font.family": "sans-serif",
    "font.size": 10,
    "text.color": GREY,
    "axes.edgecolor": GREY,
    "axes.labelcolor": GREY,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
}


def command() -> np.ndarray:
    """Torque of the experiment (n) [N m]."""
    starts, levels = np.transpose(PULSES)
    return np.r_[0.0, levels][np.searchsorted(starts, TIME, side="right")]


def figure(name: str, without: twin.Recording) -> Figure:
    """Hub angle with and without an effect, and the differences of hub angle and base strain."""
    having = simulated({name: PLANTED[name]})
    page = Figure(figsize=(9, 2.2), layout="constrained")
    axes, *rest = page.subplots(1, 1 + len(CHANNELS))
    for recording, colour, width in ((without, GREY, 3.5), (having, BLUE, 1.4)):
        draw(axes, "hub_angle", recording["hub_angle"], colour, width, "")
    for beside, channel in zip(rest, CHANNELS, strict=True):
        draw(beside, channel, having[channel] - without[channel], BLUE, 1.4, "difference of ")
    return page


def draw(axes: Axes, channel: str, values: np.ndarray, colour: str, width: float, what: str) -> None:
    """A channel over time, in the unit that people read."""
    shown = labels.channel(channel)
    axes.plot(TIME[::SHOWN], np.round(shown.factor * values[::SHOWN], 3), color=colour, lw=width)
    axes.set(xlabel="time, s")
    axes.set_title(f"{what}{shown.label}, {shown.unit}", color=GREY, fontsize=10, loc="left")


def simulated(effects: dict[str, dict[str, float]]) -> twin.Recording:
    """The experiment on a rig with effects."""
    rig = twin.rig().replace(static_friction=STATIC_FRICTION)
    return twin.model(rig, effects).simulate(TIME, command(), channels=CHANNELS)


def main() -> None:
    """Draws every effect of the library, or those that are named."""
    folder = PICTURES / "effects"
    folder.mkdir(parents=True, exist_ok=True)
    without = simulated({})
    with mpl.rc_context(STYLE):
        for name in sys.argv[1:] or REGISTRY:
            figure(name, without).savefig(
                folder / f"{name}.svg", transparent=True, metadata={"Date": None, "Creator": None}
            )


if __name__ == "__main__":
    main()
