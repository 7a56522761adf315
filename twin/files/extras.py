"""Libraries that are no dependencies: those of an extra."""

from __future__ import annotations

import importlib
from types import ModuleType

from twin.errors import InputError


def imported(module: str, needed: str, extra: str, otherwise: str = "") -> ModuleType:
    """Imports a library of an extra.

    Args:
      module: its name.
      needed: what it does, and the package that has it, as "an FMU is written with pythonfmu".
      extra: that installs it.
      otherwise: what to do without it, as the end of a sentence.

    Raises:
      InputError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise InputError(
            f"{needed}, which is not installed; install it in the clone of flexlink-twin by "
            f"pip install -e '.[{extra}]'{otherwise}"
        ) from None
