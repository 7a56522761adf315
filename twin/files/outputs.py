"""Destinations of results, checked before anything is computed, so that no file of the user is overwritten.

A folder of results is recognised by a marker file, which is written first.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twin.errors import InputError
from twin.files.text import read_text
from twin.files.whole import check_file, check_folder, check_place, is_temporary, write_files, writing

MARKER = ".twin-results"
"""Name of the file that says which kind of results a folder holds."""
_FORMAT = 1  # of the marker
_LARGEST_ANSWER = 10_000_000  # bytes; that of a long diagnosis has some hundred thousand


@dataclass(frozen=True)
class ResultsFolder:
    """The folder of results of a command.

    Attributes:
      kind: kind of the results, say "diagnosis".
      files: description of each file -> its name in the folder.
      answer: name of the JSON file with all results, which is written last.
      keys: keys that this file has at least; by them folders without a marker, of earlier versions, are recognised.
      parts: kind of the results that subfolders hold; None where there are none.
    """

    kind: str
    files: Mapping[str, str]
    answer: str
    keys: frozenset[str]
    parts: ResultsFolder | None = None

    def choose(self, out: Path | None, campaign: Path, force: bool = False) -> Path:
        """Returns the folder to write to, in which at most earlier results of the same kind are overwritten.

        Args:
          out: the folder that the user named; None for one in the working directory, named after the campaign.
          campaign: folder of the campaign.
          force: accept a folder that contains other files.

        Raises:
          InputError: the folder contains other files, is not a folder, or cannot be written to.
        """
        folder = self.named_after(campaign) if out is None else out
        self._check(folder, force)
        check_folder(folder)
        for name in (MARKER, *self.files.values()):
            check_place(folder / name)
        return folder

    def write(self, folder: Path, contents: Mapping[str, str | bytes | None]) -> None:
        """Writes results: all of them as temporary files, which then replace earlier ones, the answer last.

        Args:
          folder: where to; created if necessary.
          contents: name of a file -> content; None for a file of earlier results that is removed.

        Raises:
          InputError: the folder cannot be written.
        """
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        marker = json.dumps({"kind": self.kind, "format": _FORMAT}) + "\n"
        ordered = sorted(contents, key=lambda name: name == self.answer)
        write_files({folder / MARKER: marker, **{folder / name: contents[name] for name in ordered}})

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
        own = (MARKER, *(self.files.values() if self._wrote(folder) else ()))
        foreign = [n for n in names if n not in own and not is_temporary(n) and not self._is_part(folder / n)]
        if foreign and not force:
            raise InputError(
                f"{folder} holds {foreign[0]}{' and more' if foreign[1:] else ''}, which no {self.kind} wrote; "
                "name another folder with --out, or write into this one with --force"
            )

    def _is_part(self, path: Path) -> bool:
        """Whether a path is a folder of the results that subfolders hold."""
        if self.parts is None or not path.is_dir():
            return False
        try:
            self.parts._check(path, force=False)
        except InputError:
            return False
        return True

    def _wrote(self, folder: Path) -> bool:
        """Whether a folder contains results of an earlier run."""
        if os.path.lexists(folder / MARKER):
            return _json_object(folder / MARKER).get("kind") == self.kind
        return bool(self.keys) and self.keys <= _json_object(folder / self.answer).keys()


def _json_object(file: Path) -> dict[str, Any]:
    """Returns the object in a JSON file; empty if there is none."""
    try:
        content = json.loads(read_text(file, file.name, _LARGEST_ANSWER))
    except (InputError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


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
      InputError: a path cannot be written, is in a folder that does not exist, or is equal to another path.
    """
    named = [file for file in files if file is not None]
    _check_apart([*beside, *named], [file for file in read if file is not None])
    for file in named:
        check_file(file, made)


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
