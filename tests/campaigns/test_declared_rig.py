"""A rig in the place of the declared one passes the checks of a campaign."""

import pytest
from campaign_folder import FIT, HELD_OUT, toml_text, write

from twin.campaigns.campaign import read_campaign
from twin.campaigns.declared_rig import with_rig
from twin.errors import InputError

CABLE = {"cable-torsion": {"stiffness": 0.01, "rest_angle": 0.0}}


@pytest.fixture
def campaign(tmp_path):
    return read_campaign(write(tmp_path))


def test_a_rig_that_fits_is_taken_with_its_effects(campaign):
    other = with_rig(
        campaign, campaign.rig.replace(tip_mass=0.01), CABLE, {"cable-torsion": {"stiffness": 1e-4}}
    )
    assert other.rig["tip_mass"] == 0.01
    assert other.effects == CABLE
    assert other.effect_errors == {"cable-torsion": {"stiffness": 1e-4}}


def test_a_link_that_ends_before_a_gauge_is_refused(campaign):
    with pytest.raises(
        InputError, match="'my-rig' cannot be that of small: strain_base is 0.02 m .* 0 to 0.018 m"
    ):
        with_rig(campaign, campaign.rig.replace(length=0.018), {})


def test_a_link_shorter_than_its_deflection_is_refused(tmp_path):
    held = FIT + "\ninitial_tip_deflection = 0.3"
    campaign = read_campaign(write(tmp_path, toml_text(recordings=(held, HELD_OUT))))
    with pytest.raises(
        InputError, match="push.csv.initial_tip_deflection is 0.3 m; expected less than 0.2 m"
    ):
        with_rig(campaign, campaign.rig.replace(length=0.2), {})


def test_an_inertia_that_the_torque_cannot_turn_is_refused(campaign):
    with pytest.raises(InputError, match="torque_command.unit"):
        with_rig(campaign, campaign.rig.replace(hub_inertia=10.0), {})


def test_a_link_too_fast_to_simulate_is_refused(tmp_path):
    toml = toml_text().replace("bending_stiffness = 0.25", "bending_stiffness = 1e6")
    with pytest.raises(InputError, match="vibrates too fast"):
        read_campaign(write(tmp_path, toml))
