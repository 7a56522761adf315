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
    return {e: {c: np.concatenate(parts) for c, parts in columns.items()} for e, columns in found.items()}
