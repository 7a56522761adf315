"""Draws the pictures of docs/method.md from the diagnosis of the bundled campaign, and prints its table.

python docs/tools/draw_method.py      (minutes: it runs the diagnosis)
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import files

import matplotlib as mpl
import numpy as np
from drawing import THEMES, Theme, save, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import twin
from twin import labels

HELD_OUT = "bang-bang-52.csv"
SHOWN = 1500  # samples of a scatter plot


def free_run(axes: Axes, diagnosis: twin.Diagnosis, theme: Theme) -> None:
    """Hub angle of a held-out recording beside free runs of the declared and the completed model."""
    prediction = diagnosis.answer.predictions[HELD_OUT]
    lines = (
        (prediction.measured, "measured", theme.faint, 5, "-"),
        (prediction.before, "declared model", theme.orange, 1.8, (0, (5, 2))),
        (prediction.after, "completed model", theme.blue, 1.8, "-"),
    )
    for recording, label, colour, width, dash in lines:
        angle = np.degrees(recording["hub_angle"])
        axes.plot(recording.time, angle, color=colour, lw=width, ls=dash, label=label)
    axes.set(xlabel="time, s", ylabel="hub angle, °")
    axes.legend(loc="lower left")


def missing_torque(axes: Axes, diagnosis: twin.Diagnosis, theme: Theme) -> None:
    """Torque that the calibrated model lacks, over the hub angle, and the spring that was found."""
    trace = next(t for t in diagnosis.answer.traces if t.channel == "hub_torque")
    angle, torque = trace.variables["hub_angle"], trace.values
    use = np.flatnonzero(np.isfinite(torque) & np.isfinite(angle))
    use = use[:: max(1, len(use) // SHOWN)]
    axes.plot(
        np.degrees(angle[use]),
        1e3 * torque[use],
        ".",
        color=theme.faint,
        ms=2.5,
        label="recordings that were fitted",
    )
    spring = diagnosis.effects[0].parameters
    ends = np.array([angle[use].min(), angle[use].max()])
    line = -spring["stiffness"] * (ends - spring["rest_angle"])
    axes.plot(np.degrees(ends), 1e3 * line, color=theme.blue, lw=2.2, label="the spring that was found")
    axes.set(xlabel="hub angle, °", ylabel="missing torque, mN·m")
    axes.legend(loc="lower left")


def scores(axes: Axes, diagnosis: twin.Diagnosis, theme: Theme) -> None:
    """Scores of the best candidates of the first round, and the least score that counts."""
    best = diagnosis.answer.ranking[:4][::-1]
    colours = [theme.blue if name == diagnosis.effects[0].name else theme.fill for name, _ in best]
    bars = axes.barh(
        [name for name, _ in best], [score for _, score in best], color=colours, edgecolor=theme.faint
    )
    axes.bar_label(bars, fmt="%.0f", padding=4)
    axes.axvline(diagnosis.answer.least_score, color=theme.orange, lw=1.8, ls=(0, (5, 2)))
    axes.set(xlabel="score (dashed: the least that counts)")
    axes.margins(x=0.12)


PICTURES: dict[str, Callable[[Axes, twin.Diagnosis, Theme], None]] = {
    "free-run": free_run,
    "missing-torque": missing_torque,
    "scores": scores,
}


def draw(diagnosis: twin.Diagnosis) -> None:
    """Draws every picture in both themes."""
    for theme in THEMES:
        for name, picture in PICTURES.items():
            with mpl.rc_context(style(theme)):
                page = Figure(figsize=(8, 3.2), layout="constrained")
                picture(page.add_subplot(), diagnosis, theme)
                print(save(page, name, theme))


def table(diagnosis: twin.Diagnosis) -> str:
    """Rows of errors of the hub angle on the held-out recording, model by model."""
    names = {"before": "declared", "calibrated": "calibrated", "after": "with the spring"}
    budget = diagnosis.to_json()["error_budget"][HELD_OUT]["hub_angle"]
    return "\n".join(
        f"| {name} | {labels.amount('hub_angle', budget[model]['rms'])} |" for model, name in names.items()
    )


def main() -> None:
    """Diagnoses the bundled campaign, draws, and prints the rows of the table."""
    diagnosis = twin.diagnose(files("twin") / "data" / "demo-rig")
    draw(diagnosis)
    print(table(diagnosis))


if __name__ == "__main__":
    main()
