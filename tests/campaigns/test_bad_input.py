"""Bad input: the message names file and line or field, what was found and what would be right."""

from __future__ import annotations

import numpy as np
import pytest
from campaign_folder import CHANNELS, FIT, GAUGE, HELD_OUT, HUB, RIG, csv_text, motion, toml_text, write

from twin.campaigns.campaign import read_campaign
from twin.errors import InputError

TEXT = csv_text(motion())
LINES = TEXT.splitlines()


def refusal(folder) -> str:
    """Returns the message with which a campaign is refused; the folder stays as it was."""
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    with pytest.raises(InputError) as caught:
        read_campaign(folder)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    return str(caught.value)


def channel(name: str, lines: str) -> str:
    return toml_text(CHANNELS | {name: lines})


def entry(lines: str) -> str:
    return toml_text(recordings=(f"{FIT}\n{lines}", HELD_OUT))


def with_line(number: int, line: str) -> str:
    """Returns the CSV text with another line, counted from 1."""
    return "\n".join([*LINES[: number - 1], line, *LINES[number:]])


TOML = {
    "format 2": (toml_text().replace("format = 1", "format = 2"), "format is 2; expected one of: 1"),
    "format true": (toml_text().replace("format = 1", "format = true"), "format is true; expected a number"),
    "no format": (toml_text().replace("format = 1\n", ""), "format is missing; expected format = 1"),
    "no name": (toml_text().replace('name = "small"\n', ""), "name is missing"),
    "no rig": (toml_text(rig=RIG.replace('rig = "my-rig"', "")), "rig is missing; expected rig ="),
    "unknown key": (f"rgi = 3\n{toml_text()}", "unknown key rgi;", "did you mean 'rig'?"),
    "unknown key of a channel": (
        channel("hub_angle", f"{HUB}\nofset = 1.0"),
        "unknown key channels.hub_angle.ofset; expected one of: ",
        "did you mean 'offset'?",
    ),
    "unknown key of a recording": (
        entry("clampd = true"),
        "unknown key recordings[1] (push.csv).clampd; expected one of: ",
        "did you mean 'clamped'?",
    ),
    "unknown channel": (
        channel("hub_angel", HUB),
        "channels.hub_angel is not a channel",
        "did you mean 'hub_angle'?",
    ),
    "unknown parameter": (
        toml_text(rig=f"{RIG}\ntip_mas = 0.1"),
        "parameters.tip_mas is not a parameter",
        "did you mean 'tip_mass'?",
    ),
    "unknown parameter in [uncertainty]": (
        toml_text(rig=f"{RIG}\n[uncertainty]\nlenght = 0.1"),
        "uncertainty.lenght is not a parameter",
        "did you mean 'length'?",
    ),
    "no unit": (
        channel("hub_angle", "noise = 1e-4"),
        'channels.hub_angle.unit is missing; expected unit = "..."',
    ),
    "unknown unit": (
        channel("torque_command", 'unit = "Nm"'),
        "channels.torque_command.unit: 'Nm' is not a unit of the recording format",
        "did you mean 'N*m'?",
    ),
    "unit of another quantity": (
        channel("hub_angle", 'unit = "mm"'),
        "channels.hub_angle.unit: 'mm' does not measure hub_angle; expected one of: rad, deg, V, A",
    ),
    "time in seconds": (channel("time", 'unit = "Sec"'), "channels.time.unit: 'Sec'", "did you mean 's'?"),
    "a voltage drive without its motor": (
        toml_text() + '[drive]\nkind = "voltage"\n',
        'drive.torque_constant is missing; kind = "voltage" needs it',
    ),
    "time with a gain": (
        channel("time", 'unit = "s"\ngain = 0.001'),
        "channels.time.gain has no meaning for the time",
    ),
    "volts without gain": (
        channel("hub_angle", 'unit = "V"'),
        "channels.hub_angle.gain is missing; unit 'V' needs it: hub_angle [rad] = gain * (raw - offset)",
    ),
    "amperes without gain": (
        channel("torque_command", 'unit = "A"'),
        "channels.torque_command.gain is missing; unit 'A' needs it",
    ),
    "gain 0": (channel("hub_angle", f"{HUB}\ngain = 0.0"), "channels.hub_angle.gain is 0"),
    "gain in quotes": (
        channel("hub_angle", f'{HUB}\ngain = "0.07"'),
        "channels.hub_angle.gain is '0.07'; expected a number",
    ),
    "infinite offset": (
        channel("hub_angle", f"{HUB}\noffset = inf"),
        "offset is inf; expected a finite number",
    ),
    "negative noise": (
        channel("hub_angle", 'unit = "rad"\nnoise = -1e-4'),
        "channels.hub_angle.noise is -0.0001; expected a number >= 0",
    ),
    "gauge without position": (
        channel("strain_base", 'unit = "1"\nhalf_thickness = 0.001'),
        "channels.strain_base.position is missing",
    ),
    "gauge without half thickness": (
        channel("strain_base", 'unit = "1"\nposition = 0.02'),
        "channels.strain_base.half_thickness is missing",
    ),
    "position in mm": (
        channel("strain_base", GAUGE.replace("0.02", "20.0")),
        "channels.strain_base.position is 20 m; expected 0 to 0.4 m, the length of the link",
    ),
    "half thickness 0": (
        channel("strain_base", GAUGE.replace("0.001", "0")),
        "channels.strain_base.half_thickness is 0; expected a number > 0",
    ),
    "no hub angle of a free hub": (
        toml_text({"torque_command": 'unit = "N*m"', "strain_base": GAUGE}),
        "channels.hub_angle is missing; expected it for push.csv: only a recording with clamped = true may lack it",
    ),
    "no torque_command": (
        toml_text({"hub_angle": HUB}),
        "channels.torque_command is missing; expected the torque that drives the rig",
    ),
    "nothing measured": (
        toml_text({"torque_command": 'unit = "N*m"'}),
        "channels has no measurement; expected one of: hub_angle, hub_rate, strain_base",
    ),
    "one column for two channels": (
        channel("strain_mid", f'column = "strain_base"\n{GAUGE}'),
        "column 'strain_base' serves 2 channels",
    ),
    "column that no file has": (
        channel("strain_mid", f'column = "strian_base"\n{GAUGE}'),
        "channels.strain_mid: no recording has a column 'strian_base'",
        "did you mean 'strain_base'?",
    ),
    "channel is no table": (
        toml_text().replace("[channels.hub_angle]", "[channels]\nhub_angle = 3\n[channels.time]"),
        "channels.hub_angle is 3; expected a table",
    ),
    "no channels": (
        f'format = 1\nname = "small"\n{RIG}\n[[recordings]]\n{FIT}',
        "channels is missing; expected one [channels.<name>] table per channel",
    ),
    "no recordings": (toml_text(recordings=()), "recordings is missing; expected one [[recordings]] table"),
    "one recording without list": (
        toml_text(recordings=(FIT,)).replace("[[recordings]]", "[recordings]"),
        "recordings is a table; expected a list of [[...]] tables",
    ),
    "no fit recordings": (toml_text(recordings=(HELD_OUT,)), 'no recording has role = "fit"'),
    "no role": (
        toml_text(recordings=('file = "push.csv"',)),
        'recordings[1] (push.csv).role is missing; expected role = "fit" or role = "holdout"',
    ),
    "unknown role": (
        toml_text(recordings=(FIT, HELD_OUT.replace("holdout", "hold-out"))),
        "recordings[2] (pull.csv).role is 'hold-out'; expected one of: 'fit', 'holdout'",
        "did you mean 'holdout'?",
    ),
    "unknown loop": (
        entry('loop = "close"'),
        "recordings[1] (push.csv).loop is 'close'; expected one of: 'open', 'closed'",
        "did you mean 'closed'?",
    ),
    "unknown start": (
        entry('start = "moving"'),
        "recordings[1] (push.csv).start is 'moving'; expected one of: 'rest', 'unknown'",
    ),
    "clamped in quotes": (
        entry('clamped = "true"'),
        "recordings[1] (push.csv).clamped is 'true'; expected true or false",
    ),
    "deflection in mm": (
        entry("initial_tip_deflection = 30.0"),
        "recordings[1] (push.csv).initial_tip_deflection is 30 m; expected less than 0.4 m",
    ),
    "file twice": (
        toml_text(recordings=(FIT, HELD_OUT.replace("pull", "./push"))),
        "recordings: push.csv is listed 2 times; expected each file once",
    ),
    "missing file": (
        toml_text(recordings=(FIT.replace("push", "psuh"),)),
        "psuh.csv: there is no such file in ",
        "did you mean 'push.csv'?",
    ),
    "file is a folder": (
        toml_text(recordings=(FIT.replace("push.csv", "."),)),
        ". is a folder; expected a CSV file",
    ),
    "file of another folder": (
        toml_text(recordings=(FIT, HELD_OUT.replace("pull.csv", "sub/../../pull.csv"))),
        "campaign.toml: recordings[2].file is 'sub/../../pull.csv'; expected a file in the folder of the campaign: "
        "put it there, or a link to it",
    ),
    "absolute file": (
        toml_text(recordings=(FIT.replace("push.csv", "/push.csv"), HELD_OUT)),
        "campaign.toml: recordings[1].file is '/push.csv'; expected a file in the folder of the campaign",
    ),
    "file of a name without end": (
        toml_text(recordings=(FIT.replace("push", "p" * 2000), HELD_OUT)),
        "file is 'pppppppppp",
        "...'; expected a text of at most 1000 characters",
    ),
    "control characters in a key": (
        f'"\\u001b[2J\\u202e" = 3\n{toml_text()}',
        "unknown key \\x1b[2J\\u202e; expected one of: ",
    ),
    "integer of 5000 digits": (
        toml_text(rig=f"{RIG}\ntip_mass = {'9' * 5000}"),
        "campaign.toml: a whole number has more than 4300 digits; expected a campaign as TOML",
    ),
    "integer beyond a float": (
        toml_text(rig=f"{RIG}\ntip_mass = {'9' * 400}"),
        "campaign.toml: parameters.tip_mass is beyond the largest number, 1.8e308; expected a smaller one",
    ),
    "required parameters": (
        toml_text(rig='rig = "bosi2009"\n[parameters]\nlength = 0.4'),
        "rig 'bosi2009' is not a preset (bossi2009, ",
        "missing: bending_stiffness, linear_density, hub_inertia; did you mean 'bossi2009'?",
    ),
    "negative parameter": (
        toml_text(rig=f"{RIG}\ntip_mass = -0.1"),
        "parameters.tip_mass is -0.1 kg; expected 0 to 1000",
    ),
    "parameter is not a number": (
        toml_text(rig=f"{RIG}\ntip_mass = nan"),
        "parameters.tip_mass is nan; expected a number",
    ),
    "text for a parameter": (
        toml_text(rig=f'{RIG}\ntip_mass = "heavy"'),
        "parameters.tip_mass is 'heavy'; expected a number",
    ),
    "negative uncertainty": (
        toml_text(rig=f"{RIG}\n[uncertainty]\nlength = -0.1"),
        "uncertainty.length is -0.1; expected a number >= 0",
    ),
    "value without quotes": (toml_text().replace('"small"', "small"), ", line 2, column 8: "),
    "text that does not end": (toml_text().replace('"small"', '"small'), ", line 2, column 14: "),
    "key twice": (f"format = 1\n{toml_text()}", ", line 2, column 11: Cannot overwrite a value"),
    "empty file": ("", "format is missing", "channels is missing", "recordings is missing"),
}


@pytest.mark.parametrize(("toml", "parts"), [(t, p) for t, *p in TOML.values()], ids=TOML)
def test_campaign_file_refused(tmp_path, toml, parts):
    message = refusal(write(tmp_path, toml))
    for part in parts:
        assert part in message
    about_a_recording = ("psuh.csv: ", ". is a folder")
    assert message.startswith(("campaign.toml", *about_a_recording))


CSV: dict[str, tuple[str | bytes | dict[str, np.ndarray], str]] = {
    "empty": (b"", "push.csv, line 1 is empty; expected a header line"),
    "header alone": (LINES[0], "push.csv has no samples after its header; expected at least 2"),
    "one sample": ("\n".join(LINES[:2]), "push.csv has one sample after its header; expected at least 2"),
    "no header": ("\n".join(LINES[1:]), "push.csv, line 1 is '0,0,"),
    "semicolons and both decimal signs": (
        with_line(5, "0,012,0,0,0").replace(",", ";").replace("0;012", "0,012"),
        "expected a number with a decimal comma, as others of the file",
    ),
    "a row of text below the header": (
        "\n".join([LINES[0], "a,b,c,d", *LINES[1:]]),
        "push.csv, line 2: time is 'a'; expected a number",
    ),
    "preamble without a table": ("# card 7\n\n", "push.csv, line 3 is empty; expected a header line"),
    "preamble without a header": (
        "\n".join(["# card 7", *LINES[1:]]),
        "push.csv, line 2 is '0,0,",
    ),
    "decimal commas": (
        TEXT.replace(".", ","),
        "fields; expected 4, as in the header; if the comma is the decimal sign, write a decimal point",
    ),
    "decimal comma in quotes": (
        with_line(5, '0.012,0,"0,5",0'),
        "push.csv, line 5: hub_angle is '0,5'; expected a number (decimal point, not comma), an empty field",
    ),
    "column twice": (
        TEXT.replace("strain_base", "hub_angle", 1),
        "push.csv, line 1: column 'hub_angle' occurs twice; expected each name once",
    ),
    "short row": (with_line(5, "0.012,0,0"), "push.csv, line 5 has 3 fields; expected 4, as in the header"),
    "long row": (
        with_line(5, "0.012,0,0,0,0"),
        "push.csv, line 5 has 5 fields; expected 4, as in the header",
    ),
    "text in a number": (
        with_line(5, "0.012,0,abc,0"),
        "push.csv, line 5: hub_angle is 'abc'; expected a number, an empty field or nan",
    ),
    "text after an empty line": (
        with_line(5, "\n0.012,0,abc,0"),
        "push.csv, line 6: hub_angle is 'abc'; expected a number, an empty field or nan",
    ),
    "text next to a missing sample": (
        with_line(5, "0.012,,abc,"),
        "push.csv, line 5: hub_angle is 'abc'; expected a number, an empty field or nan",
    ),
    "number with a unit": (
        with_line(5, "0.012,0,0.1 rad,0"),
        "push.csv, line 5: hub_angle is '0.1 rad'; expected",
    ),
    "infinite": (with_line(5, "0.012,0,inf,0"), "push.csv, line 5: hub_angle is 'inf'; expected a number"),
    "overflow": (
        with_line(5, "0.012,0,1e999,0"),
        "push.csv, line 5: hub_angle is '1e999'; expected a number",
    ),
    "huge": (with_line(5, "0.012,0,1e200,0"), "push.csv, line 5: hub_angle is '1e200'; expected a number"),
    "Latin-1": (
        with_line(5, "0.012,0,0,0").replace("hub_angle", "hub_angle\u00b0").encode("latin-1"),
        "push.csv, line 1: column 'hub_angle' is missing; only a recording with clamped = true "
        "may lack it; the columns are: time, torque_command, hub_angle\u00b0, strain_base; did you mean "
        "'hub_angle\u00b0'?",
    ),
    "UTF-16 without a mark": (TEXT.encode("utf-16-le"), "push.csv, line 1: byte 0x00 is no text"),
    "binary": (bytes(range(256)), "push.csv, line "),
    "no time": (
        TEXT.replace("time", "tiem", 1),
        "push.csv, line 1: column 'time' is missing; expected the time in s; did you mean 'tiem'?",
    ),
    "time missing": (with_line(5, ",0,0,0"), "push.csv, line 5: time is missing; expected a number"),
    "time goes back": (
        with_line(5, "0.006,0,0,0"),
        "push.csv, line 5: time is 0.006 after 0.008; expected it to increase strictly",
    ),
    "time stands": (
        with_line(5, "0.008,0,0,0"),
        "push.csv, line 5: time is 0.008 after 0.008; expected it to increase strictly",
    ),
    "no hub angle": (
        TEXT.replace("hub_angle", "hub_angel", 1),
        "push.csv, line 1: column 'hub_angle' is missing; only a recording with clamped = true "
        "may lack it; the columns are: time, torque_command, hub_angel, strain_base; did you mean 'hub_angel'?",
    ),
    "no torque": (
        TEXT.replace("torque_command", "volts", 1),
        "push.csv, line 1: column 'torque_command' is missing; only a recording with clamped",
    ),
    "time in ms": (
        motion() | {"time": 1000 * motion()["time"]},
        "push.csv: the samples are 4 s apart by time; expected at most 0.1 s: is it in milliseconds?",
    ),
    "clock set": (
        motion() | {"time": motion()["time"] + np.where(np.arange(500) < 300, 0.0, 1.7e5)},
        "push.csv, line 302: time is 170001.2 after 1.196; expected one recording without such gaps",
    ),
    "terminal escapes": (
        with_line(5, "0.012,\x1b]0;owned\x07\x1b[2J,0,0"),
        "push.csv, line 5: torque_command is '\\x1b]0;owned\\x07\\x1b[2J'; expected a number",
    ),
    "long field": (with_line(5, f"0.012,0,{'x' * 1000},0"), "push.csv, line 5: hub_angle is 'xxxxxxxxxx"),
    "long line": ("x" * 1_000_001, "push.csv, line 1 has more than 1000000 characters; expected fewer"),
    "many columns": (
        ",".join(f"c{k}" for k in range(10_001)),
        "line 1 has 10001 columns; expected at most 10000",
    ),
    "NUL": (with_line(5, "0.012,0,\0,0"), "push.csv, line 5: byte 0x00 is no text"),
    "strain missing everywhere": (
        motion() | {"strain_base": np.full(500, np.nan)},
        "push.csv: strain_base is missing in all 500 samples; expected numbers",
    ),
    "hub angle missing everywhere": (
        motion() | {"hub_angle": np.full(500, np.nan)},
        "push.csv: hub_angle is missing in all 500 samples; expected numbers",
    ),
    "torque missing everywhere": (
        motion() | {"torque_command": np.full(500, np.nan)},
        "push.csv: torque_command is missing in all 500 samples; expected numbers",
    ),
}


@pytest.mark.parametrize(("content", "part"), CSV.values(), ids=CSV)
def test_recording_refused(tmp_path, content, part):
    assert part in refusal(write(tmp_path, push=content))


@pytest.mark.parametrize(("content", "part"), CSV.values(), ids=CSV)
def test_held_out_recording_refused(tmp_path, content, part):
    assert part.replace("push.csv", "pull.csv") in refusal(write(tmp_path, pull=content))


def test_clamped_recording_without_measurement(tmp_path):
    raw = motion()
    bare = {name: raw[name] for name in ("time", "torque_command")}
    message = refusal(write(tmp_path, entry("clamped = true"), push=bare))
    assert message == "push.csv has no measurement; expected a column: hub_angle, strain_base"


def test_no_such_folder(tmp_path):
    with pytest.raises(
        InputError, match=r"nowhere: there is no such folder; expected a folder with campaign.toml"
    ):
        read_campaign(tmp_path / "nowhere")


def test_folder_without_campaign_file(tmp_path):
    with pytest.raises(InputError, match=r"has no campaign.toml; expected a campaign folder"):
        read_campaign(tmp_path)


def test_path_is_the_campaign_file(tmp_path):
    write(tmp_path)
    with pytest.raises(InputError, match=r"is a file; expected a folder with campaign.toml; did you mean '"):
        read_campaign(tmp_path / "campaign.toml")


def test_campaign_file_in_another_encoding(tmp_path):
    write(tmp_path)
    (tmp_path / "campaign.toml").write_bytes(toml_text().replace("small", "m\u00fcll").encode("latin-1"))
    assert refusal(tmp_path).startswith("campaign.toml, line 2: byte 0xfc is not UTF-8")


def test_static_test_with_text(tmp_path):
    message = refusal(write(tmp_path, static="load,strain\n1.0,0.1\n2.0,much\n"))
    assert message == "static.csv, line 3: strain is 'much'; expected a number, an empty field or nan"


def test_static_test_without_rows(tmp_path):
    assert "static.csv has no rows after its header" in refusal(write(tmp_path, static="load,strain\n"))


# Data that contradict themselves


def test_dead_gauge_refused(tmp_path):
    push, pull = (motion(peak=peak) | {"strain_base": np.zeros(500)} for peak in (0.1, -0.1))
    message = refusal(write(tmp_path, push=push, pull=pull))
    assert message.startswith(
        "campaign.toml: channels.strain_base never changes: it is 0 throughout push.csv, "
    )


def test_dead_hub_angle_refused(tmp_path):
    push, pull = (motion(peak=peak) | {"hub_angle": np.full(500, 0.2)} for peak in (0.1, -0.1))
    message = refusal(write(tmp_path, push=push, pull=pull))
    assert message.startswith(
        "campaign.toml: channels.hub_angle never changes: it is 0.2 rad throughout push.csv"
    )


def test_copy_of_a_recording_refused(tmp_path):
    assert refusal(write(tmp_path, pull=motion())) == (
        "pull.csv holds the same samples as push.csv; expected each recording once in campaign.toml"
    )


def test_drive_without_torque_refused(tmp_path):
    message = refusal(write(tmp_path, toml_text(rig=f"{RIG}\ntorque_limit = 0.0")))
    assert message.startswith("campaign.toml: parameters.torque_limit is 0")


def test_uncertainty_in_percent_is_told(tmp_path):
    toml = toml_text(rig=f"{RIG}\n\n[uncertainty]\nhub_inertia = 2")
    (warning,) = read_campaign(write(tmp_path, toml)).warnings
    assert warning.startswith("campaign.toml: uncertainty.hub_inertia is 2, which is 200 % of its value")
    assert warning.endswith("for 2 % write 0.02")


@pytest.mark.parametrize("limit", ["", "torque_limit = 0.2"])
@pytest.mark.parametrize("start", ["rest", "unknown"])
@pytest.mark.parametrize("factor", [1000.0, 0.001])
def test_torque_in_another_unit_refused(tmp_path, factor, start, limit):
    raw = motion()
    scaled = raw | {"torque_command": factor * raw["torque_command"]}
    toml = toml_text(rig=f"{RIG}\n{limit}", recordings=(f'{FIT}\nstart = "{start}"', HELD_OUT))
    message = refusal(write(tmp_path, toml, push=scaled, pull=scaled))
    assert message.startswith("campaign.toml: channels.torque_command.unit: in push.csv the command ")
    assert message.endswith("expected N*m at the hub: check the unit or the gain")


def test_command_far_beyond_the_limit_is_judged_by_what_the_amplifier_gives(tmp_path):
    # A controller asks for much more than its amplifier gives.
    raw = motion()
    asked = 200.0 * raw["torque_command"]
    limit = float(np.max(np.abs(asked))) / 40.0
    toml = toml_text(rig=f"{RIG}\ntorque_limit = {limit:.4g}")
    assert read_campaign(write(tmp_path, toml, push=raw | {"torque_command": asked})).warnings == ()


@pytest.mark.parametrize("factor", [3.0, 1 / 3])
def test_torque_gain_may_be_off_by_three(tmp_path, factor):
    # A voltage drive has a nominal gain only.
    raw = motion()
    scaled = raw | {"torque_command": factor * raw["torque_command"]}
    assert read_campaign(write(tmp_path, push=scaled)).warnings == ()


def test_torque_too_small_to_overcome_the_static_friction_refused(tmp_path):
    weak = motion(peak=0.1) | {"torque_command": motion(peak=0.001)["torque_command"]}
    message = refusal(write(tmp_path, toml_text(rig=f"{RIG}\nstatic_friction = 0.05"), push=weak))
    assert "peaks at 0.001 N*m, where the motion of hub_angle takes" in message


def test_hub_that_coasts_without_torque_is_no_fault(tmp_path):
    # Friction slows it down: no torque is needed for that.
    time = motion()["time"]
    coasting = motion() | {"torque_command": np.zeros(500), "hub_angle": 3 * time - 0.7 * time**2}
    assert read_campaign(write(tmp_path, entry('start = "unknown"'), push=coasting)).warnings == ()


def test_released_link_may_turn_a_free_hub(tmp_path):
    released = motion() | {"torque_command": np.zeros(500)}
    assert read_campaign(write(tmp_path, entry("initial_tip_deflection = 0.02"), push=released)).fit


# Rigs that do not move


def resting(torque):
    """Two seconds of noise about a resting hub and a straight link, a torque commanded in the middle of it."""
    noise, time = np.random.default_rng(4), motion()["time"]
    command = np.where((time > 0.1) & (time < 0.3), torque, 0.0)
    raw = {"torque_command": command, "hub_angle": 0.3 + 1e-4 * noise.standard_normal(500)}
    return motion() | raw | {"strain_base": 1e-6 * noise.standard_normal(500)}


def test_recordings_in_which_nothing_moves_refused(tmp_path):
    message = refusal(write(tmp_path, push=resting(0.01)))
    assert message.startswith(
        "nothing moves in push.csv: every channel stays within 12 times its noise; expected"
    )


@pytest.mark.parametrize(("torque", "said"), [(0.04, False), (-0.2, True)])
def test_a_hub_that_rests_under_a_strong_torque_is_told(tmp_path, torque, said):
    toml = toml_text(rig=f"{RIG}\nstatic_friction = 0.05")
    warnings = read_campaign(write(tmp_path, toml, pull=resting(torque))).warnings
    told = [
        w for w in warnings if w.startswith("pull.csv: the hub rests throughout though 0.2 N*m are commanded")
    ]
    assert len(told) == said


def test_a_link_in_the_folder_may_lead_to_a_recording_elsewhere(tmp_path):
    (tmp_path / "here").mkdir()
    write(tmp_path / "here")
    (tmp_path / "here" / "push.csv").rename(tmp_path / "there.csv")
    (tmp_path / "here" / "push.csv").symlink_to(tmp_path / "there.csv")
    [fit] = read_campaign(tmp_path / "here").fit
    assert fit.name == "push.csv"
