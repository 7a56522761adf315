"""Destinations of results, checked before anything is computed, so that no file of the user is overwritten."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from twin.errors import InputError
from twin.files.text import read_text

_LARGEST_ANSWER = 10_000_000  # bytes; that of a long diagnosis has some hundred thousand


@dataclass(frozen=True)
class ResultsFolder:
    """The folder of results of a command.

    Attributes:
      kind: kind of the results, say "diagnosis".
      files: description of each file -> its name in the folder.
      answer: name of the JSON file by which such a folder is recognised.
      keys: keys that this file has at least.
    """

    kind: str
    files: Mapping[str, str]
    answer: str
    keys: frozenset[str]

    def choose(self, out: Path | None, campaign: Path, force: bool = False) -> Path:
        """Returns the folder to write to, in which at most earlier results of the same kind are overwritten.

        Args:
          out: the folder that the user named; None for one in the working directory, named after the campaign.
          campaign: folder of the campaign.
          force: accept a folder that contains other files.

        Raises:
          InputError: the folder contains other files, or is not a folder.
        """
        folder = self.named_after(campaign) if out is None else out
        self._check(folder, force)
        return folder

    def named_after(self, campaign: Path) -> Path:
        """Returns the default folder: in the working directory, named after a campaign."""
        return Path(f"{campaign.resolve().name or 'campaign'}-{self.kind}")

    def output_files(self, folder: Path, answer: Path | None = None) -> tuple[Path, ...]:
        """Returns the files that a command writes to a folder.

        Args:
          folder: the folder.
          answer: a JSON file that is written in addition; where it is the folder's own, that one is not listed.
        """
        files = [folder / name for name in self.files.values()]
        if answer is not None and _same(answer, folder / self.answer):
            files.remove(folder / self.answer)
        return tuple(files)

    def _check(self, folder: Path, force: bool) -> None:
        """Raises InputError where `choose` does."""
        with _readable(folder):
            if not folder.exists():
                return
            if not folder.is_dir():
                raise InputError(f"{folder} is a file; expected a folder for the results, new or empty")
            names = sorted(path.name for path in folder.iterdir())
        own = self.files.values() if self._wrote(folder) else ()
        foreign = [name for name in names if name not in own]
        if foreign and not force:
            raise InputError(
                f"{folder} holds {foreign[0]}{' and more' if foreign[1:] else ''}, which no {self.kind} wrote; "
                "name another folder with --out, or write into this one with --force"
            )

    def _wrote(self, folder: Path) -> bool:
        """Whether a folder contains results of an earlier run."""
        try:
            content = json.loads(read_text(folder / self.answer, self.answer, _LARGEST_ANSWER))
        except (ValueError, RecursionError):
            return False
        return isinstance(content, dict) and self.keys <= content.keys()


def check_writable(
    *files: Path | None,
    made: Path | None = None,
    beside: Iterable[Path] = (),
    read: Iterable[Path | None] = (),
) -> None:
    """Makes sure that files can be written, that all paths differ, and that no file that is read is overwritten.

    Args:
      files: paths that the user named; None for a file that is not written.
      made: a folder that will be created before the files are written.
      beside: other files that the same command writes.
      read: files that it reads; None for one that it does not.

    Raises:
      InputError: a path is a folder, or in a folder that does not exist, or equal to another path.
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
    """Raises InputError where a written file is one that is read, or written twice."""
    for number, file in enumerate(written):
        for other in read:
            if _same(file, other):
                raise InputError(f"cannot write {file}: it is {other}, which is read; name another place")
        for other in written[:number]:
            if _same(file, other):
                raise InputError(f"cannot write {file}: another result goes to {other}; name a file for each")


def _same(file: Path, other: Path) -> bool:
    """Whether two paths are the same regular file; devices such as /dev/null never are."""
    with _readable(file):
        if file.exists() and other.exists():
            return file.is_file() and file.samefile(other)
        return os.path.realpath(file) == os.path.realpath(other)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Raises InputError where the path cannot be accessed."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot look at {path}: {error.strerror}") from error


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Context in which a folder or file is written; an OSError becomes an InputError with the path and the reason.

    Raises:
      InputError: it cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error
