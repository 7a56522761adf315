"""Files that are written whole or not at all.

Content goes to a temporary file in the same folder, which replaces the old file once it is on the disk. What a killed
process leaves behind is a temporary file, known by its name and removed by the next one that writes there.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import stat
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from twin.errors import InputError

_PROCESS = secrets.token_hex(4)  # tells this process from an earlier one with the same number
_TEMPORARY = re.compile(r"\.twin-(\d+)-([0-9a-f]{8})-[0-9a-f]{8}\.tmp")
_DESCRIPTOR = re.compile(r"/dev/(?:fd/(\d+)|std(out|err))|/proc/self/fd/(\d+)")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Context in which a folder or file is written; an OSError becomes an InputError with the path and the reason.

    Raises:
      InputError: it cannot be written.
    """
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        if isinstance(error, InputError):
            raise
        raise InputError(f"cannot write {path}: {getattr(error, 'strerror', None) or error}") from error


def write_file(path: Path, content: str | bytes) -> None:
    """Writes one file, see `write_files`."""
    write_files({path: content})


def write_files(contents: Mapping[Path, str | bytes | None]) -> None:
    """Writes files: at any instant each of them is either the old or the new one.

    All are on the disk as temporary files before the first one replaces its predecessor, in the order given.

    Args:
      contents: path -> content, text as UTF-8; None for a file that is removed.

    Raises:
      InputError: a file cannot be written; those already replaced stay new, the others old.
    """
    temporaries: dict[Path, Path] = {}
    try:
        for path, content in contents.items():
            if content is not None:
                with writing(path):
                    _write(path, _encoded(content), temporaries)
        for path, content in contents.items():
            with writing(path):
                if content is None:
                    path.unlink(missing_ok=True)
                elif path in temporaries:
                    os.replace(temporaries[path], path)
    finally:
        for temporary in temporaries.values():
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


def write_new_files(contents: Mapping[Path, str | Path]) -> None:
    """Writes files of which none exists; folders are made.

    All are on the disk as temporary files before the first one gets its name, in the order given.

    Args:
      contents: path -> text, or the path of a file that is copied.

    Raises:
      InputError: one exists, or cannot be written; those that have their names already stay.
    """
    temporaries: dict[Path, Path] = {}
    try:
        for path, content in contents.items():
            with writing(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                temporaries[path] = temporary_path(path.parent)
                if isinstance(content, Path):
                    shutil.copyfile(content, temporaries[path])
                else:
                    temporaries[path].write_bytes(_encoded(content))
        for path, temporary in temporaries.items():
            with writing(path):
                _name_anew(temporary, path)
    finally:
        for temporary in temporaries.values():
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


def _name_anew(temporary: Path, path: Path) -> None:
    """Gives a file a name that no file has."""
    try:
        os.link(temporary, path)  # fails where the path exists, unlike a renaming
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from None
        os.rename(temporary, path)


def is_stream(path: Path) -> bool:
    """Whether a path is a device, a pipe or an open file of this process, which is written to in place."""
    if _DESCRIPTOR.fullmatch(str(path)):
        return True
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def check_place(path: Path) -> None:
    """Makes sure that a file may be written at a path, whose folder need not exist.

    Raises:
      InputError: there is a folder, a symbolic link, or a file that is write-protected.
    """
    if is_stream(path):
        return
    with writing(path):
        if path.is_symlink():
            target = os.readlink(path)
            raise InputError(
                f"cannot write {path}: it is a link to {target}; name a file, or remove the link"
            )
        if path.is_dir():
            raise InputError(f"cannot write {path}: it is a folder")
        if path.exists() and not os.access(path, os.W_OK):
            raise InputError(f"cannot write {path}: it is write-protected")


def check_file(path: Path, made: Path | None = None) -> None:
    """Makes sure that a file can be written, by making and removing another one in its folder.

    Args:
      path: the file.
      made: a folder that will be made before.

    Raises:
      InputError: as `check_place` and `check_folder`, or there is no such folder.
    """
    check_place(path)
    if is_stream(path):
        return
    with writing(path):
        there = path.parent.is_dir() or (made is not None and path.parent.resolve() == made.resolve())
    if not there:
        raise InputError(f"cannot write {path}: there is no folder {path.parent}")
    check_folder(path.parent)


def check_folder(folder: Path) -> None:
    """Makes sure that files can be made in a folder, which need not exist: tries, and removes what it made.

    Raises:
      InputError: the folder cannot be made or written to.
    """
    made: list[Path] = []
    with writing(folder):
        try:
            for part in (*reversed(folder.parents), folder):
                if not part.is_dir():
                    _make_folder(part)
                    made.append(part)
            remove_leftovers(folder)
            trial = temporary_path(folder)
            try:
                trial.touch(exist_ok=False)
            finally:
                trial.unlink(missing_ok=True)
        finally:
            for part in reversed(made):
                with suppress(OSError):
                    part.rmdir()


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir()
    except FileExistsError:
        if not folder.is_dir():
            what = f"a link to {os.readlink(folder)}" if folder.is_symlink() else "a file"
            raise InputError(f"cannot write into {folder}: it is {what}; expected a folder") from None


def temporary_path(folder: Path) -> Path:
    """Returns a new name for a temporary file of this process, short enough for any file system."""
    return folder / f".twin-{os.getpid()}-{_PROCESS}-{secrets.token_hex(4)}.tmp"


def is_temporary(name: str) -> bool:
    """Whether a file's name is that of a temporary file of this or another process."""
    return _TEMPORARY.fullmatch(name) is not None


def remove_leftovers(folder: Path) -> None:
    """Removes the temporary files of processes that have ended."""
    with suppress(OSError):  # of a folder that cannot be listed, or is gone
        for path in list(folder.iterdir()):
            match = _TEMPORARY.fullmatch(path.name)
            if match and match[2] != _PROCESS and not _runs(int(match[1])):
                path.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    """Whether another process with this number runs; on Windows, where asking would end it, it is taken to."""
    if os.name == "nt":
        return True
    if process == os.getpid():
        return False
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def _encoded(content: str | bytes) -> bytes:
    # A lone surrogate, from a file name that is not UTF-8, could not be written.
    return content if isinstance(content, bytes) else content.encode("utf-8", "replace")


def _write(path: Path, content: bytes, temporaries: dict[Path, Path]) -> None:
    """Writes a stream in place, or a temporary file, whose path is added to `temporaries`."""
    check_place(path)
    if is_stream(path):
        _write_stream(path, content)
        return
    temporaries[path] = temporary_path(path.parent)
    with temporaries[path].open("xb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    with suppress(FileNotFoundError):
        temporaries[path].chmod(stat.S_IMODE(path.stat().st_mode))


def _write_stream(path: Path, content: bytes) -> None:
    match = _DESCRIPTOR.fullmatch(str(path))
    if match is None:
        path.write_bytes(content)
        return
    # A copy of the descriptor, as opening the file anew would begin at its start, over what it already holds.
    number = int(match[1] or match[3] or {"out": 1, "err": 2}[match[2]])
    if sys.stdout is not None:
        sys.stdout.flush()
    with open(os.dup(number), "wb") as file:
        file.write(content)
