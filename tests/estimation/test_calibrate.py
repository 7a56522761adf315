"""Recordings in which the declared link runs away under the measured motion of the hub."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from twin.campaigns.campaign import read_campaign
from twin.errors import InputError
from twin.estimation.calibrate import calibrate
from twin.residuals import make_view, static_levels
from twin.virtual_rig import Rig, Sensors, make_campaign
from twin.virtual_rig.experiments import bang_bang, free_vibration


@pytest.fixture
def campaign(tmp_path):
    draw = np.random.default_rng(1)
    plan = [free_vibration(Rig(), Sensors(), draw), bang_bang(Rig(), Sensors(), draw, 45.0)]
    make_campaign(tmp_path / "rig", {}, 3, experiments=plan)
    return read_campaign(tmp_path / "rig")


@pytest.fixture
def runs_away(monkeypatch):
    """Every simulation on a moving hub ends in numbers that are none."""
    propagated = make_view.propagated_noise

    def lost(signals, prepared, model):
        noise, torque = propagated(signals, prepared, model)
        return noise, np.full_like(torque, np.nan)

    monkeypatch.setattr(make_view, "propagated_noise", lost)


def test_they_are_left_out_and_named(campaign, runs_away):
    with ThreadPoolExecutor(2) as pool:
        found = calibrate(campaign, pool)
    assert {found.prepared[g.recording].recording.name for g in found.data.groups} == {"free-vibration.csv"}
    assert any("bang-bang-45.csv could not be used" in note for note in found.notes)
    assert np.isfinite(found.base.values).all()
    # Rests in them are asked for their static levels all the same.
    assert static_levels.levels(found.data, found.base.model, found.base.starts) == {}


def test_where_there_is_no_other_it_is_an_error(tmp_path, runs_away):
    plan = [bang_bang(Rig(), Sensors(), np.random.default_rng(1), 45.0)]
    make_campaign(tmp_path / "rig", {}, 3, experiments=plan)
    with (
        ThreadPoolExecutor(2) as pool,
        pytest.raises(InputError, match=r"bang-bang-45.csv: the declared link runs away"),
    ):
        calibrate(read_campaign(tmp_path / "rig"), pool)
