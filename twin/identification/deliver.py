"""Writes the results of an identification: a folder with the report, the JSON answer and the rig file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from twin.files.json import to_text
from twin.files.outputs import ResultsFolder
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
    contents = {
        "report": page.render(result),
        "answer": to_text(result.to_json()),
        "rig": rig_file.to_toml(result),
    }
    FOLDER.write(folder, {FILES[what]: content for what, content in contents.items()})
    return {what: folder / name for what, name in FILES.items()}
