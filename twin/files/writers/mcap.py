"""MCAP files with mcap: messages in JSON."""

from __future__ import annotations

import io
import json
import math

from twin.files.writers.base import Columns, Units, Writer

TOPIC = "rig"
"""Topic of the messages; as a column, `hub_angle` is `rig.hub_angle`."""
_SCHEMA = "twin.Sample"


class Mcap(Writer):
    """An MCAP file: a message in JSON for each sample, logged at its time, with all columns but that."""

    kind = "an MCAP file"
    suffixes = (".mcap",)

    def check(self) -> None:
        self.library("mcap.writer", "mcap")

    def content(self, columns: Columns, units: Units) -> bytes:
        library = self.library("mcap.writer", "mcap")
        stream = io.BytesIO()
        writer = library.Writer(stream)
        writer.start(library="flexlink-twin")
        names = [name for name in columns if name != "time"]
        schema = writer.register_schema(_SCHEMA, "jsonschema", _schema(names, units))
        channel = writer.register_channel(TOPIC, "json", schema)
        for k, row in enumerate(zip(*(columns[name].tolist() for name in names), strict=True)):
            stamp = round(float(columns["time"][k]) * 1e9)
            present = {name: v for name, v in zip(names, row, strict=True) if math.isfinite(v)}
            writer.add_message(channel, stamp, json.dumps(present).encode(), stamp, k)
        writer.finish()
        return stream.getvalue()


def _schema(names: list[str], units: Units) -> bytes:
    properties = {name: {"type": "number", "description": units.get(name, "")} for name in names}
    return json.dumps({"title": _SCHEMA, "type": "object", "properties": properties}).encode()
