"""Campaigns of the virtual rig: each is simulated once a session, by the worker that asks for it first."""

from __future__ import annotations

import hashlib
import json
import pickle
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.campaigns.campaign import Campaign, read_campaign
from twin.virtual_rig import Rig, Sensors, Truth, make_campaign
from twin.virtual_rig.experiments import Experiment, planned_campaign

QUIET = Sensors(
    hub_noise=1e-9, strain_noise=1e-11, torque_noise=1e-8, hub_step=0, strain_step=0, torque_step=0
)
"""Sensors without noise."""

NOISE = {"hub_angle": 1e-4, "strain_base": 2e-6, "strain_mid": 2e-6, "motor_torque": 1e-3}
"""Noise to assume of `QUIET` sensors: weights need one."""


def planned(seed: int, *names: str) -> list[Experiment]:
    """Experiments of the random plan of a campaign: those whose names begin with one of these, or all."""
    plan = planned_campaign(Rig(), Sensors(), np.random.default_rng(seed))
    return [e for e in plan if not names or e.name.startswith(names)]


def planned_fit(seed: int, *names: str) -> list[Experiment]:
    """The same without those that are held out."""
    return [e for e in planned(seed, *names) if e.role == "fit"]


@dataclass(frozen=True)
class Made:
    """A campaign on disk, which no test may change, and what it does not declare."""

    folder: Path
    truth: Truth

    def read(self) -> Campaign:
        return read_campaign(self.folder)


class RigCampaigns:
    """Makes campaigns, or returns those that were made before with the same arguments.

    Args:
        store: Folder that all workers of a session share.
    """

    def __init__(self, store: Path):
        self._store = store

    def __call__(self, effects: Mapping[str, Mapping[str, float]], seed: int, **options) -> Made:
        """The campaign that `make_campaign` makes of these arguments."""
        asked = pickle.dumps((effects, seed, sorted(options.items())))
        place = self._store / hashlib.sha256(asked).hexdigest()[:16]
        if not place.exists():
            self._make(place, effects, seed, options)
        truth = json.loads((place / "truth.json").read_text(encoding="utf-8"))
        return Made(place / "rig", Truth(**truth))

    def _make(self, place: Path, effects, seed: int, options) -> None:
        # Renamed when it is complete: a worker that asks meanwhile makes its own, and one of the two stays.
        draft = Path(tempfile.mkdtemp(dir=self._store))
        make_campaign(draft / "rig", effects, seed, truth_file=draft / "truth.json", **options)
        try:
            draft.rename(place)
        except OSError:
            if not place.exists():
                raise
            shutil.rmtree(draft)
