"""Equations of motion round alike in the process that compiles them and in those that load them."""

from __future__ import annotations

import os
import subprocess
import sys

PRINT_MOTION = """
import numpy as np
from twin.mechanics import planar
from twin.rigs import preset
from twin.rigs.model import Model
from twin.mechanics import chain

rig = preset("bossi2009")
plant = Model(rig, {}, chain.fit_shape(rig, 5), {}, step=2e-3).plant
time = 0.002 * np.arange(200)
swing, still = np.sin(9 * time), np.zeros(len(plant.link.lengths))
middle = -81 * np.sin(9 * (time[:-1] + 0.001))
hub = swing, 9 * np.cos(9 * time), -81 * swing, middle
moved = planar.simulate_prescribed_hub(plant, time, *hub, still, still, 0.001)
print([values.tobytes().hex() for values in moved])
"""


def test_the_first_run_rounds_as_later_ones(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    first, later = (
        subprocess.run(
            [sys.executable, "-c", PRINT_MOTION], env=environment, capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    )
    assert list(tmp_path.rglob("planar._simulate_prescribed_hub*.nbc"))
    assert len(first) > 1000
    assert first == later
