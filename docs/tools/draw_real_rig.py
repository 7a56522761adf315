"""Draws the picture of docs/real-rigs.md for one rig from its diagnosis, and prints verdict and error budget.

python docs/tools/draw_real_rig.py FOLDER      (ten minutes: it runs the diagnosis)

FOLDER holds recordings and a campaign.toml; the picture takes its name.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
from drawing import THEMES, Theme, save, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import twin
from twin import labels
from twin.campaigns.campaign import Campaign, read_campaign
from twin.diagnosis.answer import Prediction
from twin.diagnosis.error_budget import ChannelBudget, ModelError

POINTS = 1500
"""Points of a line: as many as a picture of this width resolves."""


def draw(campaign: Campaign, name: str, predictions: dict[str, Prediction]) -> None:
    """Draws hub angle and link of the first held-out recording, in both themes."""
    file, prediction = next(iter(predictions.items()))
    channels = [c for c in prediction.budget if c in prediction.after]
    for theme in THEMES:
        with mpl.rc_context(style(theme)):
            page = Figure(figsize=(8, 1 + 2.1 * len(channels)), layout="constrained")
            rows = np.atleast_1d(page.subplots(len(channels), sharex=True))
            for axes, channel in zip(rows, channels, strict=True):
                _lines(axes, prediction, channel, theme, _display(campaign, channel))
            rows[0].set_title(f"{file}, held out", fontsize=11, loc="left")
            rows[-1].set_xlabel("time, s")
            page.legend(*rows[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
            print(save(page, name, theme))


def _display(campaign: Campaign, channel: str) -> labels.Display:
    """The unit for people; a gauge whose half thickness is declared as 1 m reads the curvature."""
    if channel in campaign.sensors and campaign.sensors[channel].half_thickness == 1.0:
        return labels.Display("curvature", "1/m", 1.0)
    return labels.channel(channel)


def _lines(axes: Axes, prediction: Prediction, channel: str, theme: Theme, display: labels.Display) -> None:
    """A measured channel and the free run of the completed model."""
    for recording, label, colour, width in (
        (prediction.measured, "measured", theme.faint, 4),
        (prediction.after, "simulated from the command alone", theme.blue, 1.5),
    ):
        shown = slice(None, None, max(1, len(recording.time) // POINTS))
        axes.plot(
            recording.time[shown],
            display.factor * recording[channel][shown],
            color=colour,
            lw=width,
            label=label,
        )
    axes.set_ylabel(f"{display.label}, {display.unit}")


def table(predictions: dict[str, Prediction]) -> str:
    """The error budget of each held-out recording and channel, a line each."""
    lines = []
    for file, prediction in predictions.items():
        for channel, budget in prediction.budget.items():
            lines += [f"{file}, {labels.channel(channel).label}: " + "; ".join(_steps(channel, budget))]
    return "\n".join(lines)


def _steps(channel: str, budget: ChannelBudget) -> list[str]:
    """One phrase for each model."""
    return [
        f"{name} {_error(channel, error)}"
        for name, error in (
            ("declared", budget.before),
            ("calibrated", budget.calibrated),
            *((f"with {labels.words(effect)}", error) for effect, error in budget.steps),
        )
    ]


def _error(channel: str, error: ModelError) -> str:
    return (
        f"{labels.amount(channel, error.rms_window)} in windows and {labels.amount(channel, error.rms)} in all, "
        f"fit {error.fit_percent:.0f} %"
    )


def main() -> None:
    """Diagnoses the campaign, draws, and prints what the page quotes."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    options = parser.parse_args()
    diagnosis = twin.diagnose(options.folder)
    held_out = {f: p for f, p in diagnosis.answer.predictions.items() if p.role == "holdout"}
    draw(read_campaign(options.folder), options.folder.name, held_out)
    print(diagnosis, *diagnosis.effects, table(held_out), f"{diagnosis.answer.wall_s:.0f} s", sep="\n")


if __name__ == "__main__":
    main()
