"""Results as strictly valid JSON: NaN and infinity become null."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin.files.whole import write_file


def to_text(content: Any) -> str:
    """Returns a result as JSON."""
    return json.dumps(_plain(content), indent=1, allow_nan=False) + "\n"


def write_json(path: Path, content: Any) -> None:
    """Writes a result to the path that the user named.

    Raises:
      InputError: the path cannot be written.
    """
    write_file(path, to_text(content))


def _plain(value: Any) -> Any:
    """Returns a value made of dict, list, str, int, float, bool and None only."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    # A numpy array or number; numpy is not imported here, as that would delay `twin --help`.
    return _plain(value.tolist()) if hasattr(value, "tolist") else value
