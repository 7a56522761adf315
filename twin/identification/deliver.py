"""Writes the results of an identification: a folder with the report, the JSON answer and the rig file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from twin.files.json import write_json
from twin.files.outputs import ResultsFolder, writing
from twin.identification import page, rig_file
from twin.identification.result import Identification

ANSWER = "identification.json"
FILES: Mapping[str, str] = {"report": "identification.html", "answer": ANSWER, "rig": rig_file.FILE}
"""Kind of file -> its name in the folder."""

FOLDER = ResultsFolder("identification", FILES, ANSWER, frozenset({"parameters", "modes", "findings"}))


def deliver(result: Identification, folder: Path) -> dict[str, Path]:
    """Writes all results of an identification; returns kind of file -> path.

    Raises:
      InputError: the folder cannot be written.
    """
    paths = {what: folder / name for what, name in FILES.items()}
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        # First: by this file the folder is recognised as one of ours.
        write_json(paths["answer"], result.to_json())
        paths["report"].write_text(page.render(result), encoding="utf-8")
        paths["rig"].write_text(rig_file.to_toml(result), encoding="utf-8", errors="replace")
    return paths
