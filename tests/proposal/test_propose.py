"""Proposals for unknown files: the bundled campaign without its names, units and notes is found again."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from paths import ROOT
from scipy.io import savemat

from twin.campaigns.campaign import read_campaign
from twin.errors import InputError
from twin.files.table import read_table
from twin.files.toml import read_toml
from twin.proposal import ask, measure
from twin.proposal.campaign_text import campaign_text, needed
from twin.proposal.propose import propose

DEMO = ROOT / "twin" / "data" / "demo-rig"
FILES = sorted(DEMO.glob("*.csv"))
COLUMNS = (
    "time",
    "torque_command",
    "hub_angle",
    "strain_base",
    "strain_mid",
    "motor_torque",
    "hub_reference",
)
NAMELESS = {column: f"c{k}" for k, column in enumerate(COLUMNS)}
FOUND = {channel: f"rec.{NAMELESS[channel]}" for channel in COLUMNS[:-1]}


@pytest.fixture(scope="module")
def nameless(tmp_path_factory):
    """The bundled recordings as MATLAB structures with fields c0, c1 ..., the gauge at the base turned."""
    folder = tmp_path_factory.mktemp("nameless")
    for file in FILES:
        columns = read_table(file, file.name).columns
        sign = {"strain_base": -1.0}
        savemat(
            folder / f"{file.stem}.mat",
            {"rec": {NAMELESS[name]: sign.get(name, 1.0) * values for name, values in columns.items()}},
        )
    return sorted(folder.glob("*.mat"))


def answering(answers):
    """Answers a question by the first of these texts whose key stands in it; "" where none does."""
    return lambda question: next((text for key, text in answers.items() if key in question), "")


def test_channels_without_names_are_found_by_what_they_do(nameless):
    proposal = propose(nameless, "x")
    assert {name: c.found.column for name, c in proposal.channels.items()} == FOUND
    assert {name: c.gain for name, c in proposal.channels.items() if c.gain} == {"strain_base": -1.0}
    assert not any(c.found.is_sure for c in proposal.channels.values())
    assert {e.path.stem: e.start for e in proposal.recordings if e.clamped} == {"free-vibration": "unknown"}
    assert all(e.start == "rest" for e in proposal.recordings if not e.clamped)
    assert proposal.channels["torque_command"].unit == ""


def test_channels_with_names_are_found_with_their_units():
    proposal = propose(FILES, "x")
    assert {name: c.found.column for name, c in proposal.channels.items()} == {name: name for name in COLUMNS}
    units = {name: c.unit for name, c in proposal.channels.items()}
    assert units["torque_command"] == units["motor_torque"] == "N*m"
    assert (units["time"], units["hub_angle"], units["strain_base"]) == ("s", "rad", "1")
    loops = {e.path.stem: e.loop for e in proposal.recordings}
    assert (loops["step-120"], loops["bang-bang-30"]) == ("closed", "open")
    roles = [e.role for e in proposal.recordings]
    assert (roles.count("holdout"), roles.count("fit")) == (2, 6)


def test_a_proposal_with_all_answers_is_a_campaign(nameless, tmp_path):
    declared = read_toml(DEMO / "campaign.toml", "a campaign")["parameters"]
    gauges = {"strain_base: position": "0.02", "strain_mid: position": "0,21", "half thickness": "0.0008"}
    answers = {f"{name} [": repr(value) for name, value in declared.items()}
    answers |= {
        **gauges,
        "_command, column": "N*m",
        "motor_torque, column": "N*m",
        "step-120.mat: loop": "closed",
    }

    answer = answering(answers)
    proposal = ask.complete(propose(nameless, "x"), answer)
    assert needed(proposal) == []
    for path in nameless:
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / "campaign.toml").write_text(campaign_text(proposal), encoding="utf-8")
    campaign, demo = read_campaign(tmp_path), read_campaign(DEMO)
    assert dict(campaign.rig)["length"] == declared["length"]
    expected = {r.name.removesuffix(".csv"): r for r in (*demo.fit, *demo.holdout())}
    for recording in (*campaign.fit, *campaign.holdout()):
        true = expected[recording.name.removesuffix(".mat")]
        assert recording.clamped == true.clamped
        assert recording.loop == true.loop
        for channel in recording.measured():
            np.testing.assert_allclose(recording[channel], true[channel], atol=1e-12)


def test_a_campaign_that_waits_for_answers_says_which(nameless, tmp_path):
    proposal = propose(FILES, "x")
    for path in FILES:
        (tmp_path / path.name).symlink_to(path)
    text = campaign_text(proposal)
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_campaign(tmp_path)
    for key in ("length", "bending_stiffness", "linear_density", "hub_inertia"):
        assert key in str(caught.value)
        assert f"parameters.{key}" in needed(proposal)
    assert "channels.strain_mid.half_thickness is missing" in str(caught.value)
    assert tomllib.loads(campaign_text(propose(nameless, 'a "b"')))["name"] == 'a "b"'


def test_wrong_answers_are_asked_again(nameless):
    asked = []
    given = iter(["abc", "-3", "0.4"])

    def answer(question):
        asked.append(question)
        return next(given, "") if "length [m]" in question else ""

    proposal = ask.complete(propose(nameless, "x"), answer)
    assert proposal.parameters == {"length": 0.4}
    told = [question for question in asked if "length [m]" in question]
    assert told[1].startswith("'abc' is no number. length [m]")
    assert told[2].startswith("length is -3 m; expected")


def test_a_channel_may_be_refused_or_named_otherwise(nameless):
    def answer(question):
        return {"column rec.c4": "none", "column rec.c5": "hub_reference"}.get(question[:13], "")

    channels = ask.complete(propose(nameless, "x"), answer).channels
    assert "strain_mid" not in channels
    assert channels["hub_reference"].found.column == "rec.c5"


def test_files_without_time_are_refused(tmp_path):
    (tmp_path / "a.csv").write_text("x,y\n1,2\n0,3\n")
    with pytest.raises(
        InputError, match="^no recording among a.csv: none has a column that increases steadily"
    ):
        propose([tmp_path / "a.csv"], "x")


def test_a_file_without_rows_is_said_to_have_none(tmp_path):
    (tmp_path / "a.csv").write_text("time,u,pot\n")
    with pytest.raises(
        InputError, match="^no recording among a.csv: a header stands in each, and no rows below it"
    ):
        propose([tmp_path / "a.csv"], "x")
    entries = propose([FILES[0], tmp_path / "a.csv"], "x").recordings
    assert [entry.unusable for entry in entries] == ["", "it has no rows below its header"]


def test_columns_of_text_do_not_matter(tmp_path):
    lines = FILES[0].read_text().splitlines()
    (tmp_path / "a.csv").write_text(
        "\n".join([f"day,{lines[0]}", *(f"25.11.2026,{line}" for line in lines[1:])])
    )
    proposal = propose([tmp_path / "a.csv"], "x")
    assert proposal.channels["hub_angle"].found.column == "hub_angle"
    assert proposal.unused == {"day": ""}


# Measures

RNG = np.random.default_rng(3)


def test_a_command_leads_what_follows_it():
    command = np.repeat(RNG.choice([-1.0, 0.0, 1.0], 100), 20)
    follower = np.convolve(command, np.exp(-np.arange(100) / 20))[: len(command)]
    follower += 1e-3 * RNG.standard_normal(len(command))
    assert measure.lead(command, [follower]) > 0.7
    assert measure.lead(command, [follower]) > measure.lead(follower, [command]) + 0.1
    assert measure.stepwise(command)
    assert not measure.computed(follower)


def test_rounded_numbers_are_computed():
    sweep = np.round(np.sin(0.01 * np.arange(3000) ** 1.2), 4)
    assert measure.computed(sweep)
    assert not measure.stepwise(sweep)


@pytest.mark.parametrize(
    ("values", "expected"), [(np.arange(30.0), 1.0), (np.repeat(np.arange(20.0), 2), 0.0)]
)
def test_steadiness(values, expected):
    assert measure.steadiness(values) == expected


def test_steadiness_of_a_slew_is_less_than_that_of_a_time():
    assert measure.steadiness(1e-6 + np.linspace(0, 1, 500) ** 2) < 1.0


def test_resonance_of_a_vibration():
    time = 0.002 * np.arange(4000)
    bend = np.exp(-0.2 * time) * np.sin(2 * np.pi * 3.7 * time) + 1e-3 * RNG.standard_normal(4000)
    assert measure.resonance(time, bend) == pytest.approx(3.7, abs=0.15)
    assert measure.resonance(time, RNG.standard_normal(4000)) is None


def test_a_supply_is_no_command():
    assert not measure.signed(np.array([7.2, 7.4, 7.3]))
    assert measure.signed(np.array([0.0, 7.4, 7.3]))
    assert measure.signed(np.array([-1.0, 2.0]))


def test_the_motor_behind_a_voltage_is_asked_for(nameless, tmp_path):
    answers = {
        "_command, column": "V",
        "resistance": "2.6",
        "torque constant": "7.7 mN*m/A ± 5 %",
        "gear ratio": "70",
        "limit": "10 V",
        "length [m]": "42 cm ± 0.2 %",
    }

    answer = answering(answers)
    text = campaign_text(ask.complete(propose(nameless, "x"), answer))
    written = tomllib.loads(text)
    assert written["drive"] == {
        "kind": "voltage",
        "resistance": 2.6,
        "torque_constant": 0.0077,
        "torque_constant_uncertainty": 0.05,
        "gear_ratio": 70.0,
        "limit": 10.0,
    }
    assert written["uncertainty"]["length"] == 0.002
    assert "torque_command.gain" not in "".join(needed(ask.complete(propose(nameless, "x"), answer)))


@pytest.mark.parametrize("given", ["0.14 +-15%", "0.14 N*m/V ± 15 %", "140 mN·m, ± 15 %"])
def test_how_well_the_torque_per_volt_is_known_is_written(nameless, given):
    answers = {"_command, column": "V", "torque_command: N*m at the hub per V": given}

    answer = answering(answers)
    written = tomllib.loads(campaign_text(ask.complete(propose(nameless, "x"), answer)))
    channel = written["channels"]["torque_command"]
    assert abs(channel["gain"]) == pytest.approx(0.14)
    assert channel["gain_uncertainty"] == pytest.approx(0.15)


def test_that_a_gain_counts_as_certain_is_said(nameless):
    answers = {"_command, column": "V", "torque_command: N*m at the hub per V": "0.14"}

    answer = answering(answers)
    text = campaign_text(ask.complete(propose(nameless, "x"), answer))
    assert "# gain_uncertainty = 0.1  # a share; without it the gain counts as certain" in text


def test_no_inertia_is_asked_of_a_payload_that_is_not_there(nameless):
    asked: list[str] = []
    ask.complete(propose(nameless, "x"), lambda question: asked.append(question) or "")
    assert "tip_mass" in "".join(asked)
    assert "tip_inertia" not in "".join(asked)
    answer = answering({"tip_mass": "50 g"})
    ask.complete(propose(nameless, "x"), lambda question: asked.append(question) or answer(question))
    assert "tip_inertia" in "".join(asked)


@pytest.mark.parametrize(
    ("given", "limit"), [("10 V", 1.4), ("10 V ± 1 %", 1.4), ("1.3", 1.3), ("900 mN*m", 0.9)]
)
def test_the_limit_of_a_drive_may_be_given_in_volts(nameless, given, limit):
    answers = {
        "_command, column": "V",
        "torque_command: N*m at the hub per V": "0.14",
        "torque_limit [": given,
    }
    asked: list[str] = []
    answer = answering(answers)
    proposal = ask.complete(
        propose(nameless, "x"), lambda question: asked.append(question) or answer(question)
    )
    assert proposal.parameters == {"torque_limit": pytest.approx(limit)}
    assert any(question.startswith("torque_limit [N*m or V], ") for question in asked)


def test_a_limit_in_volts_is_refused_where_the_torque_of_a_volt_is_not_known(nameless):
    given = iter(["10 V", ""])
    asked: list[str] = []

    def answer(question):
        asked.append(question)
        return next(given) if "torque_limit [" in question else ""

    assert not ask.complete(propose(nameless, "x"), answer).parameters
    assert any("torque_limit [N*m], " in question for question in asked)
    assert any("V" in question.split("torque_limit")[0] for question in asked if "torque_limit" in question)


def test_one_friction_is_enough(nameless):
    asked: list[str] = []
    answer = answering({"static_friction [": "0.04 ± 60 %"})
    proposal = ask.complete(
        propose(nameless, "x"), lambda question: asked.append(question) or answer(question)
    )
    assert proposal.parameters == {"static_friction": 0.04, "coulomb_friction": 0.04}
    assert proposal.uncertainty == {"static_friction": 0.6, "coulomb_friction": 0.6}
    [question] = [question for question in asked if question.startswith("coulomb_friction")]
    assert question.endswith("(Enter: 0.04)? ")


def test_a_gauge_may_be_known_as_a_curvature_per_volt(nameless):
    found = propose(nameless, "x")
    unknown = replace(found.channels["strain_base"], unit="", gain=None)
    answers = {"strain_base, column": "V", "strain_base: strain per V": "0.576 1/m"}

    answer = answering(answers)
    found = replace(found, channels={**found.channels, "strain_base": unknown})
    asked: list[str] = []
    channel = ask.complete(found, lambda question: asked.append(question) or answer(question)).channels[
        "strain_base"
    ]
    assert (channel.unit, channel.gain) == ("1/m", 0.576)
    assert "strain_base: position, " in "".join(asked)
    assert "strain_base: half thickness, " not in "".join(asked)
    proposal = replace(found, channels={**found.channels, "strain_base": channel})
    assert "channels.strain_base.position" in needed(proposal)
    assert "channels.strain_base.half_thickness" not in needed(proposal)
    assert "half_thickness" not in tomllib.loads(campaign_text(proposal))["channels"]["strain_base"]
    assert "m from the neutral axis" not in campaign_text(
        replace(proposal, channels={"strain_base": channel})
    )


def test_an_implausible_half_thickness_is_asked_again(nameless):
    asked = []
    given = iter(["1", "0.8 mm"])

    def answer(question):
        asked.append(question)
        return next(given, "") if "strain_base: half thickness" in question else ""

    channel = ask.complete(propose(nameless, "x"), answer).channels["strain_base"]
    assert channel.gauge == {"half_thickness": 0.0008}
    assert any(question.startswith("half_thickness is 1 m; expected") for question in asked)


def test_the_question_for_a_channel_lists_the_channels(nameless):
    asked: list[str] = []
    ask.complete(propose(nameless, "x"), lambda question: asked.append(question) or "")
    [question] = [question for question in asked if question.startswith("column rec.c4:")]
    assert "Which channel is it: strain_mid, none, hub_reference, hub_rate, tip_deflection, " in question
    assert question.endswith(" [strain_mid]? ")


def test_the_uncertainty_is_said_to_be_a_standard_deviation():
    text = campaign_text(propose(FILES[:1], "x"))
    assert "# one standard deviation of each value above, as a share of it: in two of three cases" in text


# Signs


def bench(folder, **signs: float):
    """A bench as that of the gate: a command that turns the hub at a rate, and a link that rings."""
    time, ringing = 0.002 * np.arange(6000), 2 * np.pi * 5.8
    noise = 1e-4 * np.random.default_rng(2).standard_normal(len(time))
    strain = np.sin(ringing * time) * np.exp(-0.1 * time)
    command = np.where(time % (2 / 3) < 1 / 3, 1.0, -1.0)
    columns = {
        "u": command,
        "pot": 0.002 * np.cumsum(command) - 2e-3 * strain + noise,
        "gauge": 3 * strain + 30 * noise,
    }
    lines = [f"time,{','.join(columns)}"]
    rows = zip(time, *(signs.get(name, 1.0) * values for name, values in columns.items()), strict=True)
    (folder / "a.csv").write_text("\n".join([*lines, *(",".join(f"{x:.9g}" for x in row) for row in rows)]))
    return propose([folder / "a.csv"], "x").channels


def test_the_sign_of_a_command_is_seen_whatever_its_unit(tmp_path):
    command = bench(tmp_path)["torque_command"]
    assert (command.found.column, command.unit, command.gain) == ("u", "", None)
    assert command.sign_reason == "its sign is right in 1 of 1 recordings"


@pytest.mark.parametrize(("column", "channel"), [("u", "torque_command"), ("gauge", "strain_base")])
def test_a_column_that_counts_the_wrong_way_round_is_turned(tmp_path, column, channel):
    channels = bench(tmp_path, **{column: -1.0})
    assert {name for name, c in channels.items() if c.gain == -1.0} == {channel}
    assert "it counts the wrong way round in 1 of 1" in channels[channel].sign_reason


def test_the_sign_of_a_channel_that_was_named_otherwise_is_not_said_to_be_seen(nameless):
    def answer(question):
        return {"column rec.c3": "tip_deflection"}.get(question[:13], "")

    channel = ask.complete(propose(nameless, "x"), answer).channels["tip_deflection"]
    assert (channel.gain, channel.sign_reason) == (None, "its sign was not looked at: check it")
