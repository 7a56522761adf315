"""What a diagnosis leaves behind: a folder with the report, the rerun recording and the augmented rig."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from twin.diagnosis.answer import Diagnosis
from twin.files.json import write_json
from twin.files.outputs import ResultsFolder, writing
from twin.recording import Sensor
from twin.report import augmented_rig, write_report
from twin.report.diagnosis_rerun import write_rrd
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
"""What each file is -> its name in the folder. A patch is written where something is outside the library."""

FOLDER = ResultsFolder("diagnosis", FILES, ANSWER, frozenset({"verdict", "ranking", "errors"}))


@dataclass(frozen=True)
class Delivery:
    """What was written.

    Attributes:
      paths: what it is -> the file.
      left_out: mechanisms that the MJCF file leaves out.
    """

    paths: Mapping[str, Path]
    left_out: tuple[str, ...]


def deliver(diagnosis: Diagnosis, sensors: Mapping[str, Sensor], folder: Path) -> Delivery:
    """Writes everything that a diagnosis came to.

    Args:
      diagnosis: the answer.
      sensors: channel -> sensor, of the campaign.
      folder: where to; made if it is not there.

    Raises:
      InputError: the folder cannot be written.
    """
    paths = {what: folder / name for what, name in FILES.items()}
    patch = paths["patch"]
    if diagnosis.patched is None:
        del paths["patch"]
    mjcf = augmented_rig.to_mjcf(diagnosis, sensors)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        # First, because by it the folder is known as ours.
        write_json(paths["answer"], diagnosis.to_json())
        write_report(diagnosis, paths["report"], _beside(paths, mjcf.left_out))
        write_rrd(diagnosis, paths["rerun"], sensors)
        augmented_rig.write_augmented(diagnosis, folder)
        paths["MJCF"].write_text(mjcf.xml, encoding="utf-8")
        if diagnosis.patched is None:
            patch.unlink(missing_ok=True)  # of an earlier run
        else:
            patch.write_text(to_csv(diagnosis.patched.patch), encoding="utf-8")
    return Delivery(paths, mjcf.left_out)


def _beside(paths: Mapping[str, Path], left_out: tuple[str, ...]) -> dict[str, str]:
    """Name of each file beside the report -> what it is, and how to open it."""
    said = {
        "rerun": f"The measured arm, that of the declared model and that of the final one, moving together. "
        f"Open it with: rerun {FILES['rerun']}",
        "answer": "The answer, for programs.",
        "rig": f"The final model, with standard errors. Use it with: twin run SCENARIO --rig {FILES['rig']}",
        "MJCF": f"The final model for any MuJoCo viewer. It leaves out: {', '.join(left_out) or 'nothing'}.",
        "patch": "A lookup of what no effect explains, a correction without a cause. Add it to a run with: "
        f"twin run SCENARIO --rig {FILES['rig']} --patch {FILES['patch']}",
    }
    return {paths[what].name: text for what, text in said.items() if what in paths}
