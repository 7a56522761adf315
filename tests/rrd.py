"""Reads rerun recordings back."""

from collections import defaultdict

import numpy as np


def read(path) -> dict[str, dict[str, np.ndarray]]:
    """Returns entity -> component -> values of what is not static, with "sim_time" [s]."""
    from rerun.chunk import RrdReader

    found = defaultdict(lambda: defaultdict(list))
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if "sim_time" not in batch.schema.names:
            continue
        time = batch.column("sim_time").cast("int64").to_numpy() / 1e9
        found[str(chunk.entity_path)]["sim_time"].append(time)
        for name in batch.schema.names:
            if ":" in name:
                found[str(chunk.entity_path)][name.split(":")[-1]] += [batch.column(name).to_pylist()]
    return {e: {c: _rows(parts) for c, parts in columns.items()} for e, columns in found.items()}


def _rows(parts) -> np.ndarray:
    """The rows of all chunks; of lists where they differ in length."""
    rows = [row for part in parts for row in part]
    try:
        return np.array(rows)
    except ValueError:
        ragged = np.empty(len(rows), dtype=object)
        ragged[:] = rows
        return ragged


def layout(path) -> str:
    """Returns the layout of a recording as text."""
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    [stored] = reader.blueprints()
    batches = [chunk.to_record_batch() for chunk in reader.stream(store=stored)]
    clocks = ("log_time", "blueprint")
    columns = [(n, b.column(n).to_pylist()) for b in batches for n in b.schema.names if n not in clocks]
    return "\n".join(f"{name}: {values}" for name, values in columns)


def contents(path) -> list:
    """Returns the identity of a recording, and each chunk of it and of its layout, without those of chunk and rows.

    Without the instant at which the layout was made, too.
    """
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    [entry], [layout] = reader.recordings(), reader.blueprints()
    batches = [chunk.to_record_batch() for store in (entry, layout) for chunk in reader.stream(store=store)]
    chance = ("rerun.controls.RowId", "log_time")
    return [(entry.application_id, entry.recording_id)] + [
        {name: batch.column(name) for name in sorted(batch.schema.names) if name not in chance}
        | {"entity": batch.schema.metadata[b"rerun:entity_path"]}
        for batch in batches
    ]
