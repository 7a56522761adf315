"""Writes small campaigns: a rigid hub that a known torque turns, and a link that bends in proportion."""

from __future__ import annotations

from pathlib import Path

import numpy as np

HUB = 'unit = "rad"\nnoise = 1e-4'
GAUGE = 'unit = "1"\nnoise = 1e-6\nposition = 0.02\nhalf_thickness = 0.001'
CHANNELS = {"torque_command": 'unit = "N*m"', "hub_angle": HUB, "strain_base": GAUGE}
PARAMETERS = "length = 0.4\nlinear_density = 0.1\nbending_stiffness = 0.25\nhub_inertia = 0.02"
RIG = f'rig = "my-rig"\n\n[parameters]\n{PARAMETERS}'
FIT = 'file = "push.csv"\nrole = "fit"'
HELD_OUT = 'file = "pull.csv"\nrole = "holdout"'

INERTIA = 0.02 + 0.1 * 0.4**3 / 3  # of the rig above about its hub [kg m^2]


def motion(samples: int = 500, peak: float = 0.1, seed: int = 0) -> dict[str, np.ndarray]:
    """Returns time [s], torque [N m], hub angle [rad] and strain of a rig from rest, with sensor noise.

    The torque is tau = peak * sin(2 pi t), so the hub turns by peak/(2 pi J) * (t - sin(2 pi t)/(2 pi)).
    """
    rng = np.random.default_rng(seed)
    time = 0.004 * np.arange(samples)
    torque = peak * np.sin(2 * np.pi * time)
    turn = peak / (2 * np.pi * INERTIA) * (time - np.sin(2 * np.pi * time) / (2 * np.pi))
    return {
        "time": time,
        "torque_command": torque,
        "hub_angle": turn + 1e-4 * rng.standard_normal(samples),
        "strain_base": 2e-4 * torque / 0.1 + 1e-6 * rng.standard_normal(samples),
    }


def csv_text(columns: dict[str, np.ndarray]) -> str:
    """Returns the columns as CSV; NaN becomes an empty field."""
    rows = zip(*columns.values(), strict=True)
    lines = [",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in rows]
    return "\n".join([",".join(columns), *lines]) + "\n"


def toml_text(
    channels: dict[str, str] = CHANNELS,
    recordings: tuple[str, ...] = (FIT, HELD_OUT),
    rig: str = RIG,
) -> str:
    """Returns a campaign.toml; a channel and a recording are the lines of their table."""
    tables = [f"[channels.{name}]\n{lines}\n" for name, lines in channels.items()]
    entries = [f"[[recordings]]\n{lines}\n" for lines in recordings]
    return "\n".join(["format = 1", 'name = "small"', rig, "", *tables, *entries])


def write(folder: Path, toml: str | None = None, **files: str | bytes | dict[str, np.ndarray]) -> Path:
    """Writes a campaign; `push="..."` replaces the text of push.csv."""
    texts = {"push": motion(), "pull": motion(peak=-0.1, seed=1), **files}
    (folder / "campaign.toml").write_text(toml_text() if toml is None else toml, encoding="utf-8")
    for name, content in texts.items():
        text = csv_text(content) if isinstance(content, dict) else content
        raw = text if isinstance(text, bytes) else text.encode()
        (folder / f"{name}.csv").write_bytes(raw)
    return folder
