"""Draws the rig from above, with its angles, sensors and signs: docs/pictures/rig-light.svg and rig-dark.svg.

python docs/tools/draw_rig.py
"""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from drawing import THEMES, Theme, save, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Polygon

HUB = np.zeros(2)
ANGLE = np.radians(14)  # of the hub, as drawn
LENGTH = 6.6  # of the link, in units of the drawing
DEFLECTION = 1.2  # of the tip
GAUGES = {"strain_base": 0.11, "strain_mid": 0.52}  # channel -> place along the link, share of its length


def link(share: np.ndarray | float) -> np.ndarray:
    """Points (m, 2) of the link: a cantilever with a force at its tip, turned by the hub angle."""
    s = np.atleast_1d(share)
    bend = DEFLECTION * s**2 * (3 - s) / 2
    along = LENGTH * s - 0.6 * bend**2 / LENGTH  # a bent link does not reach as far
    return np.column_stack([along, bend]) @ _turn(ANGLE).T


def _turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def normal(share: float) -> np.ndarray:
    """Unit vector across the link, towards positive angles."""
    ahead = (link(share + 1e-3) - link(share - 1e-3))[0]
    return np.array([-ahead[1], ahead[0]]) / np.hypot(*ahead)


def arrow(axes: Axes, start, end, colour: str, bend: float = 0.0) -> None:
    """An arrow; `bend` is the curvature of its shaft."""
    axes.add_patch(
        FancyArrowPatch(
            start, end, connectionstyle=f"arc3,rad={bend}", arrowstyle="-|>", mutation_scale=15, lw=2, color=colour,
            shrinkA=0, shrinkB=0, zorder=5,
        )
    )  # fmt: skip


def note(axes: Axes, at, text: str, channel: str, colour: str, align: str = "left") -> None:
    """A label, and below it the name of its channel in the recordings."""
    axes.text(*at, text, ha=align, va="bottom", color=colour, fontsize=12)
    axes.text(
        at[0],
        at[1] - 0.08,
        channel,
        ha=align,
        va="top",
        color=colour,
        fontsize=9.5,
        family="DejaVu Sans Mono",
    )


def draw_motion(axes: Axes, theme: Theme) -> None:
    """Reference axis, tangent at the hub, hub angle, torque and tip deflection."""
    axes.plot([0.75, 7.0], [0, 0], color=theme.faint, lw=1.2, ls=(0, (6, 4)))
    axes.text(7.05, 0, "fixed direction\nin the plane", color=theme.faint, va="center", fontsize=9.5)
    tangent = _turn(ANGLE) @ [LENGTH + 0.35, 0]
    axes.plot([0, tangent[0]], [0, tangent[1]], color=theme.faint, lw=1.2, ls=(0, (6, 4)))
    axes.text(
        *(tangent + [0.1, 0.0]),
        "tangent to the link\nat the hub",
        color=theme.faint,
        va="center",
        fontsize=9.5,
    )

    axes.add_patch(Arc(HUB, 7.2, 7.2, theta1=0, theta2=np.degrees(ANGLE) - 3, color=theme.blue, lw=2))
    turned = 3.6 * np.array([np.cos(ANGLE), np.sin(ANGLE)])
    arrow(axes, 3.6 * np.array([np.cos(ANGLE - 0.06), np.sin(ANGLE - 0.06)]), turned, theme.blue)
    note(axes, (3.72, 0.38), "hub angle θ", "hub_angle", theme.blue)

    arrow(axes, (0.25, -1.12), (1.1, -0.32), theme.orange, bend=0.3)
    note(axes, (1.2, -0.95), "motor torque τ", "torque_command, motor_torque", theme.orange)

    foot = _turn(ANGLE) @ [(link(1.0)[0] @ _turn(ANGLE))[0], 0]
    arrow(axes, foot, link(1.0)[0] - 0.33 * normal(1.0), theme.green)
    note(
        axes, foot * 0.5 + link(1.0)[0] * 0.5 + [0.2, 0.12], "tip deflection w", "tip_deflection", theme.green
    )


def draw_body(axes: Axes, theme: Theme) -> None:
    """Motor, hub, link and payload on its air-pad."""
    axes.add_patch(Circle(HUB, 0.78, facecolor=theme.fill, edgecolor=theme.ink, lw=1.6, zorder=3))
    fork = np.array([[0.0, -0.2], [0.95, -0.2], [0.95, 0.2], [0.0, 0.2]]) @ _turn(ANGLE).T
    axes.add_patch(Polygon(fork, closed=True, facecolor=theme.fill, edgecolor=theme.ink, lw=1.6, zorder=3))
    axes.plot(*link(np.linspace(0.05, 1, 200)).T, color=theme.ink, lw=4.5, solid_capstyle="round", zorder=4)
    axes.add_patch(Circle(HUB, 0.1, facecolor=theme.ink, edgecolor="none", zorder=6))
    tip = link(1.0)[0]
    axes.add_patch(Circle(tip, 0.42, facecolor="none", edgecolor=theme.ink, lw=1.2, ls=(0, (2, 2)), zorder=3))
    axes.add_patch(Circle(tip, 0.28, facecolor=theme.fill, edgecolor=theme.ink, lw=1.6, zorder=5))
    axes.text(
        0.0, -1.4, "hub, turned by the motor;\nbearing with friction", ha="center", va="top", fontsize=10.5
    )
    axes.text(tip[0] - 0.6, tip[1] + 0.1, "payload on an air-pad", ha="right", va="bottom", fontsize=10.5)


def draw_gauges(axes: Axes, theme: Theme) -> None:
    """Strain gauges on the link."""
    for channel, share in GAUGES.items():
        # On the outer face, which a bend towards positive angles stretches.
        ends = link(np.array([share - 0.03, share + 0.03])) - 0.11 * normal(share)
        axes.plot(*ends.T, color=theme.blue, lw=6, solid_capstyle="butt", zorder=5)
        at = ends.mean(axis=0)
        end = at + [-0.55, 1.1]
        axes.plot(*np.array([at, end]).T, color=theme.blue, lw=1, zorder=3.5)
        note(axes, end + [0.0, 0.28], "strain gauge", channel, theme.blue, "center")


def figure(theme: Theme) -> Figure:
    """The drawing; all quantities in it are positive."""
    with mpl.rc_context(style(theme)):
        page = Figure(figsize=(10, 5.1))
        axes = page.add_axes((0, 0, 1, 1))
        axes.set(xlim=(-1.75, 8.65), ylim=(-2.1, 10.4 * 0.51 - 2.1), aspect="equal")
        axes.axis("off")
        draw_motion(axes, theme)
        draw_body(axes, theme)
        draw_gauges(axes, theme)
        axes.text(
            8.5, -1.95, "Seen from above. Angles, torque and deflection count counter-clockwise;\n"
            "a strain is positive where the link curves as drawn.",
            ha="right", va="bottom", fontsize=9.5, color=theme.faint,
        )  # fmt: skip
        return page


def main() -> None:
    """Draws both themes."""
    for theme in THEMES:
        with mpl.rc_context(style(theme)):
            print(save(figure(theme), "rig", theme))


if __name__ == "__main__":
    main()
