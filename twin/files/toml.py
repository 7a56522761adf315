"""TOML files that the user names."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from twin.errors import InputError


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """Returns the content of a TOML file.

    Args:
      path: the file.
      what: what it should contain, for the message.

    Raises:
      InputError: the file does not exist, cannot be read, or is not TOML in UTF-8.
    """
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; expected {what} as TOML") from None
    except IsADirectoryError:
        raise InputError(f"{path} is a folder; expected {what} as a TOML file") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path.name} is not UTF-8 text; expected {what} as TOML") from None
    except ValueError as error:
        raise InputError(f"{path.name} is not TOML: {error}; expected {what} as TOML") from None
