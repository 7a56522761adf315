"""What an answer was computed with and from, so that it can be computed again."""

from __future__ import annotations

import datetime
import hashlib
import shlex
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from twin.errors import InputError

_PACKAGE = "flexlink-twin"


@dataclass(frozen=True)
class Provenance:
    """What an answer was computed with and from.

    Attributes:
      version: of this package.
      date: when it was computed, UTC, ISO 8601.
      command: the command line; None for a call from Python.
      inputs: file -> SHA-256 of its bytes, hexadecimal; by name inside the campaign, by its path elsewhere.
      seeds: use of random numbers -> seed.
    """

    version: str
    date: str
    command: str | None
    inputs: Mapping[str, str]
    seeds: Mapping[str, int]

    def to_json(self) -> dict[str, Any]:
        """The record as plain values."""
        return asdict(self)


def command_line() -> str:
    """The command line of this process, as it would be typed."""
    return shlex.join(["twin", *sys.argv[1:]])


def recorded(
    files: Iterable[Path | None], folder: Path | None, command: str | None, seeds: Mapping[str, int]
) -> Provenance:
    """The record of an answer that is computed now.

    Args:
      files: that were read; None, and those that do not exist, are left out.
      folder: files inside it are named relative to it.
      command: the command line, or None.
      seeds: use of random numbers -> seed.

    Raises:
      InputError: a file cannot be read.
    """
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    inputs = {_name(path, folder): _sha256(path) for path in files if path is not None and path.exists()}
    return Provenance(version(_PACKAGE), now, command, inputs, dict(seeds))


def _name(path: Path, folder: Path | None) -> str:
    inside = folder is not None and path.is_relative_to(folder)
    return path.relative_to(folder).as_posix() if inside and folder is not None else str(path)


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
