"""What the drawings of the documentation share: two themes, one font, one way to write a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

PICTURES = Path(__file__).resolve().parent.parent / "pictures"


@dataclass(frozen=True)
class Theme:
    """Colours of a drawing that lies on a light or a dark page; blue, orange and green are told apart by colour-blind
    readers (M. Okabe and K. Ito, 2008)."""

    name: str
    ink: str
    faint: str
    fill: str
    blue: str
    orange: str
    green: str


LIGHT = Theme("light", "#1f2328", "#8b949e", "#d9dee4", "#0072b2", "#d55e00", "#00805b")
DARK = Theme("dark", "#e6edf3", "#7d8590", "#3d444d", "#56b4e9", "#ff9142", "#3fcf9f")
THEMES = (LIGHT, DARK)


def style(theme: Theme) -> dict[str, object]:
    """matplotlib's settings for a theme: no background, so that the page's own shows."""
    return {
        "svg.fonttype": "path",
        "svg.hashsalt": "flexlink-twin",
        "font.size": 11,
        "font.family": "DejaVu Sans",
        "text.color": theme.ink,
        "axes.edgecolor": theme.faint,
        "axes.labelcolor": theme.ink,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "xtick.color": theme.ink,
        "ytick.color": theme.ink,
        "legend.frameon": False,
    }


def save(figure: Figure, name: str, theme: Theme) -> Path:
    """Writes `pictures/NAME-THEME.svg`, the same bytes for the same drawing."""
    PICTURES.mkdir(exist_ok=True)
    path = PICTURES / f"{name}-{theme.name}.svg"
    figure.savefig(
        path, transparent=True, metadata={"Date": None, "Creator": f"matplotlib {matplotlib.__version__}"}
    )
    return path
