"""What an identification leaves behind: a folder with the report, the answer and the rig file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from twin.files.json import write_json
from twin.files.outputs import ResultsFolder, writing
from twin.identification import page, rig_file
from twin.identification.identify import Identification

ANSWER = "identification.json"
FILES: Mapping[str, str] = {"report": "identification.html", "answer": ANSWER, "rig": rig_file.FILE}
"""What each file is -> its name in the folder."""

FOLDER = ResultsFolder("identification", FILES, ANSWER, frozenset({"parameters", "modes", "findings"}))


def deliver(found: Identification, folder: Path) -> dict[str, Path]:
    """Writes everything that an identification came to; returns what it is -> the file.

    Raises:
      InputError: the folder cannot be written.
    """
    paths = {what: folder / name for what, name in FILES.items()}
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        # First, because by it the folder is known as ours.
        write_json(paths["answer"], found.to_json())
        paths["report"].write_text(page.render(found), encoding="utf-8")
        paths["rig"].write_text(rig_file.to_toml(found), encoding="utf-8", errors="replace")
    return paths
