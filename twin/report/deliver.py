"""Writes the results of a diagnosis: a folder with the report, the rerun recording and the augmented rig."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from twin.diagnosis.answer import Diagnosis
from twin.files.json import to_text
from twin.files.outputs import ResultsFolder
from twin.recording import Sensor
from twin.report import augmented_rig, html
from twin.report.diagnosis_rerun import to_rrd
from twin.rigs.patch import to_csv

ANSWER = "diagnosis.json"
FILES: Mapping[str, str] = {
    "report": "report.html",
    "rerun": "run.rrd",
    "answer": ANSWER,
    "rig": augmented_rig.FILE,
    "MJCF": "augmented.xml",
    "patch": "patch.csv",
}
"""Kind of file -> its name in the folder. A patch is written only where something is outside the library."""

FOLDER = ResultsFolder("diagnosis", FILES, ANSWER, frozenset({"verdict", "ranking", "errors"}))


@dataclass(frozen=True)
class Delivery:
    """The files that were written.

    Attributes:
      paths: kind of file -> path.
      left_out: mechanisms that the MJCF file leaves out.
    """

    paths: Mapping[str, Path]
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Rendered:
    """The results of a diagnosis before they are written.

    Attributes:
      contents: name of a file -> its content; None for one of earlier results that is removed.
      left_out: mechanisms that the MJCF file leaves out.
    """

    contents: Mapping[str, str | bytes | None]
    left_out: tuple[str, ...]


def deliver(diagnosis: Diagnosis, sensors: Mapping[str, Sensor], folder: Path) -> Delivery:
    """Writes all results of a diagnosis.

    Args:
      diagnosis: the answer.
      sensors: channel -> sensor, of the campaign.
      folder: where to; created if necessary.

    Raises:
      InputError: the folder cannot be written.
    """
    made = rendered(diagnosis, sensors)
    FOLDER.write(folder, made.contents)
    paths = {what: folder / name for what, name in FILES.items() if made.contents[name] is not None}
    return Delivery(paths, made.left_out)


def rendered(diagnosis: Diagnosis, sensors: Mapping[str, Sensor]) -> Rendered:
    """Returns all results of a diagnosis; arguments as `deliver`."""
    mjcf = augmented_rig.to_mjcf(diagnosis, sensors)
    written = [what for what in FILES if what != "patch" or diagnosis.patched is not None]
    contents: dict[str, str | bytes | None] = {
        "report": html.render(diagnosis, _file_descriptions(written, mjcf.left_out)),
        "rerun": to_rrd(diagnosis, sensors),
        "answer": to_text(diagnosis.to_json()),
        "rig": augmented_rig.to_toml(diagnosis),
        "MJCF": mjcf.xml,
        # None removes that of an earlier run.
        "patch": None if diagnosis.patched is None else to_csv(diagnosis.patched.patch),
    }
    return Rendered({FILES[what]: content for what, content in contents.items()}, mjcf.left_out)


def _file_descriptions(written: Collection[str], left_out: tuple[str, ...]) -> dict[str, str]:
    """Name of each file in the folder -> what it is, and how to open it."""
    texts = {
        "rerun": f"The measured arm, that of the declared model and that of the final one, moving together. "
        f"Open it with: rerun {FILES['rerun']}",
        "answer": "The answer, for programs.",
        "rig": f"The final model, with standard errors. Use it with: twin run SCENARIO --rig {FILES['rig']}",
        "MJCF": f"The final model for any MuJoCo viewer. It leaves out: {', '.join(left_out) or 'nothing'}.",
        "patch": "A lookup table of what no effect explains: a correction, no physical law. Add it to a run with: "
        f"twin run SCENARIO --rig {FILES['rig']} --patch {FILES['patch']}",
    }
    return {FILES[what]: text for what, text in texts.items() if what in written}
