"""The folder of a fleet: one folder of results for each rig, and the page over all of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from twin.files.outputs import ResultsFolder
from twin.files.provenance import Provenance
from twin.fleet import stored
from twin.fleet.stored import StoredAnswer
from twin.fleet.task import Contents
from twin.report import deliver

PREVIOUS = "previous.json"
"""File of a rig with the answer of the campaign before."""
RIG = ResultsFolder(
    "diagnosis", {**deliver.FILES, "previous answer": PREVIOUS}, deliver.ANSWER, deliver.FOLDER.keys
)
FILES: Mapping[str, str] = {"page": "fleet.html", "answer": "fleet.json"}
FOLDER = ResultsFolder("fleet", FILES, FILES["answer"], frozenset({"rigs", "effects", "failed"}), parts=RIG)
_LONGEST_NAME = 100  # characters of a folder; most file systems have 255 bytes


def folder_name(rig: str) -> str:
    """Returns the name of a rig as that of a folder: letters, digits, ".", "_" and "-" stay."""
    return re.sub(r"[^\w.-]+", "-", rig)[:_LONGEST_NAME].strip(".-") or "rig"


@dataclass(frozen=True)
class Earlier:
    """What the folder of a rig holds.

    Attributes:
      last: the answer; None where there is none.
      text: its file.
      before: the answer of the campaign before that.
    """

    last: StoredAnswer | None
    text: str
    before: StoredAnswer | None

    def answers(self, record: Provenance, rate: float) -> bool:
        """Whether the answer is of these files, by this version, at this false-alarm rate."""
        if self.last is None:
            return False
        asked = (dict(record.inputs), record.version, rate)
        of = self.last.provenance
        return (dict(of.inputs), of.version, self.last.false_alarm_rate) == asked

    def compared_with(self, record: Provenance) -> tuple[StoredAnswer | None, str | None]:
        """The answer of the campaign before the one of these files, and the file that is to be kept of it, if any."""
        if self.last is None or dict(self.last.provenance.inputs) == dict(record.inputs):
            return self.before, None
        return self.last, self.text


def earlier(folder: Path) -> Earlier:
    """Returns what the folder of a rig holds."""
    last, before = stored.read(folder / deliver.ANSWER), stored.read(folder / PREVIOUS)
    text, answer = ("", None) if last is None else last
    return Earlier(answer, text, None if before is None else before[1])


def write(folder: Path, contents: Contents, previous: str | None) -> None:
    """Writes the results of a rig, the answer last.

    Args:
      folder: of the rig.
      contents: of a diagnosis.
      previous: the answer of the campaign before; None to keep what is there.

    Raises:
      InputError: the folder cannot be written.
    """
    RIG.write(folder, {**contents, **({} if previous is None else {PREVIOUS: previous})})
