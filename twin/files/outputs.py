"""Where results go: looked at before anything is computed, so that nothing of the user's is overwritten."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from twin.errors import InputError


@dataclass(frozen=True)
class ResultsFolder:
    """A folder that a command fills.

    Attributes:
      kind: what it is of, say "diagnosis".
      files: what each file is -> its name in the folder.
      answer: the name of the JSON file by which a folder is known as such a one.
      keys: what that file has.
    """

    kind: str
    files: Mapping[str, str]
    answer: str
    keys: frozenset[str]

    def choose(self, out: Path | None, campaign: Path, force: bool = False) -> Path:
        """Returns the folder to write to, in which nothing is overwritten but earlier results of the same kind.

        Args:
          out: the folder that the user named; None for one in the working directory, named after the campaign.
          campaign: folder of the campaign.
          force: something else in the folder is no objection.

        Raises:
          InputError: the folder holds something else, or is not a folder.
        """
        folder = self.named_after(campaign) if out is None else out
        self._check(folder, force)
        return folder

    def named_after(self, campaign: Path) -> Path:
        """Returns the folder, in the working directory, that is named after a campaign."""
        return Path(f"{campaign.resolve().name or 'campaign'}-{self.kind}")

    def output_files(self, folder: Path, answer: Path | None = None) -> tuple[Path, ...]:
        """Returns the files that the command fills such a folder with, beside an answer that is written, too.

        One that goes where the folder has its own is the same.
        """
        files = [folder / name for name in self.files.values()]
        if answer is not None and _same(answer, folder / self.answer):
            files.remove(folder / self.answer)
        return tuple(files)

    def _check(self, folder: Path, force: bool) -> None:
        with _readable(folder):
            if not folder.exists():
                return
            if not folder.is_dir():
                raise InputError(f"{folder} is a file; expected a folder for the results, new or empty")
            names = sorted(path.name for path in folder.iterdir())
        ours = self.files.values() if self._wrote(folder) else ()
        foreign = [name for name in names if name not in ours]
        if foreign and not force:
            raise InputError(
                f"{folder} holds {foreign[0]}{' and more' if foreign[1:] else ''}, which no {self.kind} wrote; "
                "name another folder with --out, or write into this one with --force"
            )

    def _wrote(self, folder: Path) -> bool:
        """Whether an earlier run wrote to a folder."""
        try:
            content = json.loads((folder / self.answer).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return False
        return isinstance(content, dict) and self.keys <= content.keys()


def check_writable(
    *files: Path | None,
    made: Path | None = None,
    beside: Iterable[Path] = (),
    read: Iterable[Path | None] = (),
) -> None:
    """Makes sure that files can be written, each to a place of its own and none over what is read.

    Args:
      files: those that the user named; None for one that is not wanted.
      made: a folder that will be there by then.
      beside: other files that the same command writes.
      read: files that it reads; None for one that it does not.

    Raises:
      InputError: one is a folder, or would be in one that is not there, or coincides with another.
    """
    named = [file for file in files if file is not None]
    for file in named:
        with _readable(file):
            if file.is_dir():
                raise InputError(f"cannot write {file}: it is a folder")
            there = file.parent.is_dir() or (made is not None and file.parent.resolve() == made.resolve())
        if not there:
            raise InputError(f"cannot write {file}: there is no folder {file.parent}")
    _check_apart([*beside, *named], [file for file in read if file is not None])


def _check_apart(written: list[Path], read: list[Path]) -> None:
    for number, file in enumerate(written):
        for other in read:
            if _same(file, other):
                raise InputError(f"cannot write {file}: it is {other}, which is read; name another place")
        for other in written[:number]:
            if _same(file, other):
                raise InputError(f"cannot write {file}: another result goes to {other}; name a file for each")


def _same(file: Path, other: Path) -> bool:
    """Whether both are one file, by whatever names; what is no file, such as /dev/null, holds nothing to lose."""
    with _readable(file):
        if file.exists() and other.exists():
            return file.is_file() and file.samefile(other)
        return os.path.realpath(file) == os.path.realpath(other)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot look at {path}: {error.strerror}") from error


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Tells the user what came in the way of writing to a folder or a file.

    Raises:
      InputError: it cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error
