"""A recording in a folder within a campaign is read as the campaign describes it."""

import campaign_folder
import numpy as np
from campaign_folder import CHANNELS

from twin.report.run_files import files_read, read_track

IN_DEGREES = {**CHANNELS, "hub_angle": 'unit = "deg"\nnoise = 0.01'}


def test_a_recording_below_its_campaign(tmp_path):
    toml = campaign_folder.toml_text(IN_DEGREES).replace("push.csv", "day/push.csv")
    campaign_folder.write(tmp_path, toml)
    (tmp_path / "day").mkdir()
    path = (tmp_path / "push.csv").rename(tmp_path / "day" / "push.csv")
    angle = campaign_folder.motion()["hub_angle"]
    np.testing.assert_allclose(read_track(path).channels["hub_angle"], np.radians(angle), atol=1e-8)
    assert tmp_path / "campaign.toml" in files_read(path)


def test_a_run_below_a_campaign_that_does_not_name_it(tmp_path):
    campaign_folder.write(tmp_path, campaign_folder.toml_text(IN_DEGREES))
    (tmp_path / "day").mkdir()
    path = (tmp_path / "push.csv").rename(tmp_path / "day" / "run.csv")
    angle = campaign_folder.motion()["hub_angle"]
    np.testing.assert_allclose(read_track(path).channels["hub_angle"], angle, atol=1e-8)
    assert files_read(path) == (path,)
