"""`twin data`: text, page, JSON and exit code say whether a fit can begin."""

import html
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from campaign_folder import motion, write
from paths import ROOT

from twin.campaigns.campaign import read_campaign
from twin.diagnosis.detectable import Detectable
from twin.proposal.gate import Finding
from twin.recording import Recording
from twin.report import data_check, data_figures
from twin.report.data_check import DataCheck
from twin.report.data_figures import ReadRecording

SEEN = Detectable("cable-torsion", "stiffness", "N*m/rad", 0.0, 3e-5, 2.5e-4)
UNSEEN = Detectable("root-compliance", "stiffness", "N*m/rad", np.inf, np.inf, np.nan)
STIFF = Detectable("root-compliance", "stiffness", "N*m/rad", np.inf, np.inf, 2999.0)
GAIN = Detectable("strain-gain", "gain_base", "1", 1.0, 1e-4, 0.99)
GOOD, ODD = Finding("rate", True, "62 samples"), Finding("clock", False, "scatters")
BAD = Finding("rest", False, "something moves", fails=True)


def check(*findings, visible=(SEEN,)):
    return DataCheck("bench", findings, visible, (90.0, 7200.0))


@pytest.mark.parametrize(
    ("found", "passed", "text"),
    [
        (check(GOOD), True, "bench passes: nothing would mislead a fit."),
        (check(GOOD, ODD), True, "bench passes: one thing limits what can be found."),
        (check(ODD, ODD), True, "bench passes: 2 things limit what can be found."),
        (check(GOOD, BAD), False, "bench does not pass: a fit would be misled (rest)."),
        (
            check(GOOD, visible=(UNSEEN,)),
            False,
            "bench does not pass: its recordings show no effect of the library at any size.",
        ),
    ],
)
def test_it_passes_where_nothing_misleads_a_fit_and_something_shows(found, passed, text):
    assert found.passed is passed
    assert data_check.headline(found) == text


def test_rows_have_units_and_say_what_does_not_show():
    rows = list(data_check.visible_rows(check(visible=(SEEN, STIFF, UNSEEN, GAIN))))
    assert rows == [
        ("cable torsion", "stiffness", "0.000030 N·m/rad", "0.00025 N·m/rad"),
        ("root compliance", "stiffness", "–", "3000 N·m/rad or less"),
        ("", "stiffness", "–", "not seen"),
        ("strain gain", "gain base", "0.00010", "0.010"),
    ]


def test_the_page_says_the_same():
    page = data_check.render(check(GOOD, BAD, visible=(SEEN, GAIN)))
    for text in (
        "bench does not pass",
        "something moves",
        "cable torsion",
        "0.00025 N·m/rad",
        "2 min to 2.0 h",
        "'not seen' where these recordings show the effect at no value",
    ):
        assert text in html.unescape(page)
    assert page.count('<table class="cards') == 2
    assert "Provenance" not in page
    # A narrow screen shows the name of a column beside its value.
    assert 'data-column=""' not in page
    assert 'data-column="result"' in page


def test_the_page_names_an_effect_once():
    parameters = [replace(SEEN, effect="asymmetric-friction", parameter=f"p{k}") for k in range(4)]
    page = data_check.render(check(GOOD, visible=(*parameters, SEEN)))
    assert page.count("asymmetric friction") == 1
    assert page.count('<tr class="group">') == 2


# Figures


def read(**changes):
    time = 0.01 * np.arange(300)
    channels = {"torque_command": np.where(time < 1, 0.0, 0.3), "hub_angle": np.maximum(time - 1, 0) ** 2}
    return ReadRecording(Recording("push.csv", time, channels, **changes), "fit", ((0.0, 1.0),), 0.3)


def drawn(of: ReadRecording):
    return json.loads(data_figures.figure(of).json)


def test_a_recording_is_drawn_with_its_rests_and_its_saturation():
    figure = drawn(read())
    titles = [figure["layout"][axis]["title"]["text"] for axis in ("yaxis", "yaxis2")]
    assert titles == ["commanded torque<br>[N·m]", "hub angle<br>[°]"]
    assert [trace.get("name") for trace in figure["data"]] == [
        None,
        "at the limit of the amplifier",
        None,
        "the hub rests",
    ]
    assert {(s["x0"], s["x1"], s["yref"]) for s in figure["layout"]["shapes"]} == {
        (0.0, 1.0, "y domain"),
        (0.0, 1.0, "y2 domain"),
    }
    assert len(drawn(replace(read(), limit=np.inf, rests=()))["data"]) == 2


def test_the_page_shows_each_recording_with_what_is_declared_of_it():
    page = data_check.render(replace(check(GOOD), recordings=(read(clamped=True, start="unknown"),)))
    assert page.count('<figure class="plot"') == 1
    assert "fitted, 2.99 s, hub locked, may move at first, prescribed command" in page


def test_rests_are_those_of_the_recordings():
    campaign = read_campaign(ROOT / "twin" / "data" / "demo-rig")
    found = {r.recording.name: r for r in data_figures.read_recordings(campaign)}
    assert found["free-vibration.csv"].rests == ()
    for begin, end in found["break-away.csv"].rests:
        angle = found["break-away.csv"].recording
        inside = (angle.time > begin) & (angle.time < end)
        assert np.ptp(angle["hub_angle"][inside]) < 10 * campaign.sensors["hub_angle"].noise
    assert found["break-away.csv"].rests
    assert {r.role for r in found.values()} == {"fit", "holdout"}


def test_the_command_writes_text_page_and_json(twin, tmp_path):
    folder = tmp_path / "bench"
    folder.mkdir()
    moving = motion()
    moving["hub_angle"] = moving["hub_angle"] + 0.5 * moving["time"]
    code, output, error = twin("data", write(folder, push=moving), "--json", "a.json", "--report", "a.html")
    assert code == 1
    # Without a terminal a line stands for each stage, from the first on.
    lines = error.splitlines()
    assert lines[0] == "[0 s] 1 of 5: reading the recordings"
    assert [line.split("] ")[1][:6] for line in lines if " of 5" in line][:5] == [
        f"{k} of 5" for k in range(1, 6)
    ]
    assert "small does not pass: a fit would be misled (rest)." in output
    answer = json.loads(Path("a.json").read_text())
    assert answer["passed"] is False
    assert set(answer["provenance"]["inputs"]) == {"campaign.toml", "push.csv", "pull.csv"}
    shown = Path("a.html").read_text(encoding="utf-8")
    assert all(hash in shown for hash in answer["provenance"]["inputs"].values())
    assert {"what": "rest", "fails": True}.items() <= next(
        f for f in answer["findings"] if f["fails"]
    ).items()
    assert {"effect", "parameter", "unit", "neutral", "sigma", "found"} == answer["visible"][0].keys()
    assert 0 < answer["diagnosis_seconds"][0] < answer["diagnosis_seconds"][1]
    assert "does not pass" in Path("a.html").read_text(encoding="utf-8")
