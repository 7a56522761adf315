"""Writes the MJCF files of `models/`: `python -m twin.rigs.mjcf_files [FOLDER]`."""

from __future__ import annotations

import sys
from pathlib import Path

from twin import terminal
from twin.files.whole import write_files
from twin.mechanics.chain import build
from twin.mechanics.mjcf import build_spec
from twin.mechanics.mjcf_visuals import scene_xml
from twin.rigs import preset


def write_models(folder: Path) -> tuple[Path, ...]:
    """Writes `bossi2009.xml` and `scene.xml`; returns their paths."""
    rig = preset("bossi2009")
    spec = build_spec(rig, build(rig))
    spec.modelname = "bossi2009"
    bare, scene = folder / "bossi2009.xml", folder / "scene.xml"
    write_files({bare: _tidy(spec.to_xml()), scene: scene_xml(bare.name)})
    return bare, scene


def _tidy(xml: str) -> str:
    """Returns the XML without blank lines at the end, and with a note on its origin at the head."""
    note = (
        "<!-- Written by `python -m twin.rigs.mjcf_files models`; see README.md. "
        "Edit the generator, not this file. -->"
    )
    return f"{note}\n{xml.rstrip()}\n"


def main() -> None:
    """Writes the files of `models/` to the folder named on the command line, by default `models`."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "models")
    for path in write_models(folder):
        print(path)


if __name__ == "__main__":
    terminal.run(main)
