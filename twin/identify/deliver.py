"""What an identification leaves behind: a folder with the report, the answer and the rig file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from twin.errors import InputError
from twin.identify import page, rig_file
from twin.identify.identification import Identification
from twin.json_file import write_json

ANSWER = "identification.json"
FILES: Mapping[str, str] = {"report": "identification.html", "answer": ANSWER, "rig": rig_file.FILE}
"""What each file is -> its name in the folder."""


def default_folder(campaign: Path) -> Path:
    """Returns the folder, in the working directory, that is named after a campaign."""
    return Path(f"{campaign.resolve().name or 'campaign'}-identification")


def check_folder(folder: Path, force: bool = False) -> None:
    """Makes sure that writing to a folder overwrites nothing but an earlier identification.

    Raises:
      InputError: the folder holds something else, is not a folder, or its parent is not there.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; expected a folder for the results, new or empty")
    if not folder.exists() and not folder.resolve().parent.is_dir():
        raise InputError(f"cannot write {folder}: there is no folder {folder.parent}")
    names = {path.name for path in folder.iterdir()} if folder.exists() else set()
    foreign = sorted(names - set(FILES.values()) if ANSWER in names else names)
    if foreign and not force:
        raise InputError(
            f"{folder} holds {foreign[0]}{' and more' if foreign[1:] else ''}, which no identification wrote; "
            "name another folder with --out, or write into this one with --force"
        )


def deliver(found: Identification, folder: Path) -> dict[str, Path]:
    """Writes everything that an identification came to; returns what it is -> the file.

    Raises:
      InputError: the folder cannot be written.
    """
    paths = {what: folder / name for what, name in FILES.items()}
    try:
        folder.mkdir(exist_ok=True)
        # First, because by it the folder is known as ours.
        write_json(paths["answer"], found.to_json())
        paths["report"].write_text(page.render(found), encoding="utf-8")
        paths["rig"].write_text(rig_file.to_toml(found), encoding="utf-8", errors="replace")
    except OSError as error:
        raise InputError(f"cannot write {folder}: {error.strerror}") from error
    return paths
