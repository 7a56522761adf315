"""`twin data`: text, page, JSON and exit code say whether a fit can begin."""

import json
from pathlib import Path

import numpy as np
import pytest
from campaign_folder import motion, write

from twin.diagnosis.detectable import Detectable
from twin.proposal.gate import Finding
from twin.report import data_check
from twin.report.data_check import DataCheck

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
        (check(GOOD), True, "bench passes: nothing stands against a fit."),
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
        ("root compliance", "stiffness", "–", "below 2999 N·m/rad"),
        ("", "stiffness", "–", "none in its range"),
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
    ):
        assert text in page
    assert page.count('<table class="cards') == 2
    assert "Provenance" not in page


def test_the_command_writes_text_page_and_json(twin, tmp_path):
    folder = tmp_path / "bench"
    folder.mkdir()
    moving = motion()
    moving["hub_angle"] = moving["hub_angle"] + 0.5 * moving["time"]
    code, output, error = twin("data", write(folder, push=moving), "--json", "a.json", "--report", "a.html")
    assert (code, error) == (1, "")
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
