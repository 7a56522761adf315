"""MCAP files: messages in JSON with mcap, those of ROS 2 with mcap-ros2-support."""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from twin.errors import InputError
from twin.files.readers.base import Content, Reader, check_count

_DEEPEST = 20  # messages in messages
_WIDEST = 100  # elements of a list that become columns; longer ones are pictures and the like
_TIME = "time"


class Mcap(Reader):
    """An MCAP file: a column for each number in its messages, `topic.field`, and `time` from when they were logged.

    Topics are logged at instants of their own: at those of another topic, a column has no sample.
    """

    kind = "an MCAP file"
    suffixes = (".mcap",)

    def read(self, path: Path) -> Content:
        reader = self.library("mcap.reader", "mcap")
        rows: dict[int, dict[str, float]] = {}
        count, encodings = 0, set()
        with path.open("rb") as file:
            opened, decoders = reader.make_reader(file), _decoders()
            for schema, channel, message in opened.iter_messages(log_time_order=True):
                decoded = _decoded(decoders, schema, channel, message)
                if decoded is None:
                    encodings.add(channel.message_encoding)
                    continue
                fields = dict(_fields(channel.topic.strip("/").replace("/", "."), decoded, 0))
                rows.setdefault(message.log_time, {}).update(fields)
                check_count(count := count + len(fields))
        if not rows and encodings:
            raise InputError(
                f"its messages are encoded as {', '.join(sorted(encodings))}; expected json, or cdr (ROS 2) with "
                "mcap-ros2-support installed"
            )
        return _content(rows)


def _decoders() -> list[Any]:
    try:
        return [importlib.import_module("mcap_ros2.decoder").DecoderFactory()]
    except ImportError:
        return []


def _decoded(decoders: list[Any], schema: Any, channel: Any, message: Any) -> Any:
    """Returns a message as dicts, lists and numbers, or objects with such fields; None where it cannot be decoded."""
    if channel.message_encoding == "json":
        return json.loads(message.data)
    for factory in decoders:
        decoder = factory.decoder_for(channel.message_encoding, schema)
        if decoder is not None:
            return decoder(message.data)
    return None


def _fields(name: str, value: Any, depth: int) -> Iterator[tuple[str, float]]:
    if isinstance(value, bool | int | float):
        yield name, float(value)
    elif depth > _DEEPEST or value is None or isinstance(value, str | bytes):
        return
    elif isinstance(value, list | tuple | np.ndarray):
        for k, entry in enumerate(value) if len(value) <= _WIDEST else ():
            yield from _fields(
                f"{name}[{k}]", entry.item() if isinstance(entry, np.generic) else entry, depth + 1
            )
    else:
        parts = value.items() if isinstance(value, dict) else _slots(value)
        for key, entry in parts:
            yield from _fields(f"{name}.{key}", entry, depth + 1)


def _slots(value: Any) -> Iterator[tuple[str, Any]]:
    for key in getattr(value, "__slots__", ()):
        yield key.lstrip("_"), getattr(value, key, None)


def _content(rows: dict[int, dict[str, float]]) -> Content:
    stamps = sorted(rows)
    names = list(dict.fromkeys(name for stamp in stamps for name in rows[stamp]))
    check_count(len(stamps) * len(names))
    first = stamps[0] if stamps else 0
    columns = {_TIME: np.array([(stamp - first) * 1e-9 for stamp in stamps])}
    for name in names:
        columns[name] = np.array([rows[stamp].get(name, np.nan) for stamp in stamps])
    return Content(columns, {_TIME: "s"})
