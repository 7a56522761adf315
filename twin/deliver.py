"""What a diagnosis leaves behind: a folder with the report, the rerun recording and the augmented rig."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from twin import augmented
from twin.diagnosis import Diagnosis, Patched
from twin.errors import InputError
from twin.json_file import write_json
from twin.recording import Sensor
from twin.report import write_report
from twin.stream import write_rrd

ANSWER = "diagnosis.json"
FILES: Mapping[str, str] = {
    "report": "report.html",
    "rerun": "run.rrd",
    "answer": ANSWER,
    "rig": augmented.FILE,
    "MJCF": "augmented.xml",
    "patch": "patch.csv",
}
"""What each file is -> its name in the folder. A patch is written where something is outside the library."""


@dataclass(frozen=True)
class Delivery:
    """What was written.

    Attributes:
      paths: what it is -> the file.
      left_out: mechanisms that the MJCF file leaves out.
    """

    paths: Mapping[str, Path]
    left_out: tuple[str, ...]


def default_folder(campaign: Path) -> Path:
    """Returns the folder, in the working directory, that is named after a campaign."""
    return Path(f"{campaign.resolve().name or 'campaign'}-diagnosis")


def check_folder(folder: Path, force: bool = False) -> None:
    """Makes sure that writing to a folder overwrites nothing but an earlier diagnosis.

    Raises:
      InputError: the folder holds something else, or is not a folder.
    """
    with _readable(folder):
        if not folder.exists():
            return
        if not folder.is_dir():
            raise InputError(f"{folder} is a file; expected a folder for the results, new or empty")
        names = sorted(path.name for path in folder.iterdir())
    foreign = names if not _is_ours(folder) else [name for name in names if name not in FILES.values()]
    if foreign and not force:
        raise InputError(
            f"{folder} holds {foreign[0]}{' and more' if foreign[1:] else ''}, which no diagnosis wrote; "
            "name another folder with --out, or write into this one with --force"
        )


def check_file(file: Path, folder: Path) -> None:
    """Makes sure that a file can be written once the folder of the results is there.

    Raises:
      InputError: it is a folder, or it would be in one that is not there.
    """
    with _readable(file):
        if file.is_dir():
            raise InputError(f"cannot write {file}: it is a folder")
        if not file.parent.is_dir() and file.parent.resolve() != folder.resolve():
            raise InputError(f"cannot write {file}: there is no folder {file.parent}")


def deliver(diagnosis: Diagnosis, sensors: Mapping[str, Sensor], folder: Path) -> Delivery:
    """Writes everything that a diagnosis came to.

    Args:
      diagnosis: the answer.
      sensors: channel -> sensor, of the campaign.
      folder: where to; made if it is not there.

    Raises:
      InputError: the folder cannot be written.
    """
    from twin import augmented_mjcf  # compiles equations of motion: only where it is needed

    paths = {what: folder / name for what, name in FILES.items()}
    patch = paths.pop("patch")
    mjcf = augmented_mjcf.to_mjcf(diagnosis, sensors)
    with _writable(folder):
        folder.mkdir(parents=True, exist_ok=True)
        # First, because by it the folder is known as ours.
        write_json(paths["answer"], diagnosis.to_json())
        write_report(diagnosis, paths["report"])
        write_rrd(diagnosis, paths["rerun"], sensors)
        augmented.write_augmented(diagnosis, folder)
        paths["MJCF"].write_text(mjcf.xml, encoding="utf-8")
        if diagnosis.patched is None:
            patch.unlink(missing_ok=True)  # of an earlier run
        else:
            patch.write_text(_patch_table(diagnosis.patched), encoding="utf-8")
            paths["patch"] = patch
    return Delivery(paths, mjcf.left_out)


def _patch_table(patched: Patched) -> str:
    """The lookup as CSV: the variable and what is added, SI."""
    patch = patched.patch
    rows = [f"{x:.9g},{y:.9g},{n:.0f}" for x, y, n in zip(patch.x, patch.y, patch.count, strict=True)]
    return "\n".join([f"{patch.variable},added_to_{patch.channel},samples", *rows]) + "\n"


def _is_ours(folder: Path) -> bool:
    """Whether an earlier diagnosis wrote to a folder."""
    try:
        content = json.loads((folder / ANSWER).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and {"verdict", "ranking", "errors"} <= content.keys()


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot look at {path}: {error.strerror}") from error


@contextmanager
def _writable(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write to {folder}: {error.strerror}") from error
