"""Text files that the user names: read as a whole, once they are known to be files of a reasonable size."""

from __future__ import annotations

import codecs
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from twin.errors import InputError, nearest

_MEGABYTE = 1_000_000  # bytes
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f]")  # characters that no text has


def read_text(
    path: Path, name: str, largest: int, expected: str = "a file", older_encodings: bool = False
) -> str:
    """Returns the text of a UTF-8 file with line ends as newlines, without byte-order mark.

    Args:
      path: the file; a link to one will do.
      name: name of the file in messages.
      largest: accepted size [bytes].
      expected: what should be there, for messages.
      older_encodings: whether UTF-16 with a byte-order mark and Windows-1252 are read too, as Excel and LabVIEW write.

    Raises:
      InputError: there is no such file, it is a folder, pipe, socket or device, too large, or not in such an encoding.
    """
    name = name or str(path)  # "." has no name
    with _told(path, name):
        raw = _read(path, name, largest, expected)
    text = _decoded(raw, name, older_encodings)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def check_lines(text: str, name: str, longest: int) -> None:
    """Raises InputError where a line of a text is longer than so many characters."""
    start = 0
    while len(text) - start > longest:
        end = text.rfind("\n", start, start + longest + 1)
        if end < 0:
            line = text.count("\n", 0, start) + 1
            raise InputError(f"{name}, line {line} has more than {longest} characters; expected fewer")
        start = end + 1


def check_size(path: Path, name: str, largest: int, expected: str) -> None:
    """Raises InputError where a path is no regular file of at most so many bytes; arguments as for `read_text`."""
    with _told(path, name):
        _check_found(path.stat(), name, largest, expected)


@contextmanager
def _told(path: Path, name: str) -> Iterator[None]:
    """Raises InputError where the path cannot be read."""
    try:
        yield
    except FileNotFoundError:
        raise InputError(f"{name}: there is no such file in {path.parent}{_sibling(path)}") from None
    except OSError as error:
        raise InputError(f"{name} cannot be read: {error.strerror}") from None
    except ValueError as error:  # a NUL in the path
        raise error if isinstance(error, InputError) else InputError(f"{name} is no name of a file") from None


def _check_found(found: os.stat_result, name: str, largest: int, expected: str) -> None:
    """Raises InputError where a path is no regular file: a pipe would make the program wait, a device never end."""
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{name} is {_kind(found.st_mode)}; expected {expected}")
    if found.st_size > largest:
        raise _too_large(name, largest, expected)


def _read(path: Path, name: str, largest: int, expected: str) -> bytes:
    """Returns the bytes of a file."""
    _check_found(path.stat(), name, largest, expected)
    with path.open("rb") as file:
        # A file may grow, and those of /proc do not tell their size.
        raw = file.read(largest + 1)
    if len(raw) > largest:
        raise _too_large(name, largest, expected)
    return raw


def _too_large(name: str, largest: int, expected: str) -> InputError:
    return InputError(f"{name} has more than {largest // _MEGABYTE} MB; expected {expected} of at most that")


def _kind(mode: int) -> str:
    kinds = ((stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a pipe"), (stat.S_ISSOCK, "a socket"))
    return next((kind for is_one, kind in kinds if is_one(mode)), "a device")


def _decoded(raw: bytes, name: str, older_encodings: bool) -> str:
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        older = _older_encoding(raw) if older_encodings else None
        if older is not None:
            return older
        line = raw.count(b"\n", 0, error.start) + 1
        byte = f"byte 0x{raw[error.start]:02x}"
        raise InputError(f"{name}, line {line}: {byte} is not UTF-8; save the file as UTF-8") from None
    if (at := text.find("\0")) >= 0:
        line = text.count("\n", 0, at) + 1
        raise InputError(f"{name}, line {line}: byte 0x00 is no text; expected a text file in UTF-8")
    return text


def _older_encoding(raw: bytes) -> str | None:
    """The text of a file in UTF-16 with a byte-order mark or in Windows-1252; None where it is in neither."""
    marked = raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = raw.decode("utf-16" if marked else "cp1252")
    except UnicodeDecodeError:
        return None
    return None if _CONTROL.search(text) else text


def _sibling(path: Path) -> str:
    """Hint to a file of a similar name in the same folder, or ""."""
    try:
        return nearest(path.name, [p.name for p in path.parent.iterdir()])
    except OSError:
        return ""
