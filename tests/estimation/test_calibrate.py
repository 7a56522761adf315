"""Recordings in which the declared link runs away under the measured motion of the hub."""

import numpy as np
import pytest

from twin.errors import InputError
from twin.estimation.calibrate import calibrate
from twin.estimation.residual_pool import ResidualPool
from twin.residuals import make_view, static_levels
from twin.virtual_rig import Rig, Sensors
from twin.virtual_rig.experiments import bang_bang, free_vibration


@pytest.fixture
def campaign(rig_campaign):
    draw = np.random.default_rng(1)
    plan = [free_vibration(Rig(), Sensors(), draw), bang_bang(Rig(), Sensors(), draw, 45.0)]
    return rig_campaign({}, 3, experiments=plan).read()


@pytest.fixture
def runs_away(monkeypatch):
    """Every simulation on a moving hub ends in numbers that are none."""
    propagated = make_view.propagated_noise

    def lost(signals, prepared, model):
        noise, torque = propagated(signals, prepared, model)
        return noise, np.full_like(torque, np.nan)

    monkeypatch.setattr(make_view, "propagated_noise", lost)


@pytest.mark.slow
def test_they_are_left_out_and_named(campaign, runs_away):
    with ResidualPool(1) as pool:
        found = calibrate(campaign, pool)
    assert {found.prepared[g.recording].recording.name for g in found.data.groups} == {"free-vibration.csv"}
    assert any("bang-bang-45.csv could not be used" in note for note in found.notes)
    assert np.isfinite(found.base.values).all()
    # Rests in them are asked for their static levels all the same.
    assert static_levels.levels(found.data, found.base.model, found.base.starts) == {}


def test_where_there_is_no_other_it_is_an_error(rig_campaign, runs_away):
    plan = [bang_bang(Rig(), Sensors(), np.random.default_rng(1), 45.0)]
    campaign = rig_campaign({}, 3, experiments=plan).read()
    with (
        ResidualPool(1) as pool,
        pytest.raises(InputError, match=r"bang-bang-45.csv: the declared link runs away"),
    ):
        calibrate(campaign, pool)
