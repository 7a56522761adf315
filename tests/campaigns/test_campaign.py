"""Reading a campaign: values reach SI, missing things stay missing, roles stay apart."""

import math
import pickle
import subprocess
import sys
import time

import numpy as np
import pytest
from campaign_folder import CHANNELS, FIT, GAUGE, HELD_OUT, HUB, RIG, csv_text, motion, toml_text, write

from twin import rigs
from twin.campaigns.campaign import Campaign, read_campaign

PRESET = 'rig = "bossi2009"'


def _read(folder, **toml) -> Campaign:
    return read_campaign(write(folder, toml_text(**toml)))


# Roles


def test_fit_and_holdout_are_apart(tmp_path):
    campaign = _read(tmp_path)
    assert [r.name for r in campaign.fit] == ["push.csv"]
    assert [r.name for r in campaign.holdout()] == ["pull.csv"]


def test_recording_knows_neither_role_nor_label(tmp_path):
    label = "a-label-for-people"
    campaign = _read(tmp_path, recordings=(f'{FIT}\nexperiment = "{label}"', HELD_OUT))
    recording = campaign.fit[0]
    assert label not in repr(recording)
    assert not hasattr(recording, "role")
    assert label not in repr(campaign)


def test_what_is_held_out_does_not_show(tmp_path):
    assert "pull.csv" not in repr(_read(tmp_path))


def test_held_out_values_leave_fit_alone(tmp_path):
    first = _read(tmp_path).fit[0]
    stuck = motion(peak=-0.1) | {"strain_base": np.full(500, 1e-5)}
    second = read_campaign(write(tmp_path, pull=stuck)).fit[0]
    for channel in first.channels:
        np.testing.assert_array_equal(first[channel], second[channel])


def test_attributes_of_a_recording(tmp_path):
    lines = 'clamped = true\nloop = "closed"\nstart = "unknown"\ninitial_tip_deflection = 0.03'
    recording = _read(tmp_path, recordings=(f"{FIT}\n{lines}",)).fit[0]
    assert (recording.clamped, recording.loop, recording.start) == (True, "closed", "unknown")
    assert recording.initial_tip_deflection == 0.03


def test_campaign_survives_pickling(tmp_path):
    campaign = _read(tmp_path)
    copy = pickle.loads(pickle.dumps(campaign))
    assert copy.rig == campaign.rig
    assert dict(copy.sensors) == dict(campaign.sensors)
    np.testing.assert_array_equal(copy.holdout()[0]["hub_angle"], campaign.holdout()[0]["hub_angle"])


# Values


def test_si_values_are_those_of_the_file(tmp_path):
    recording = _read(tmp_path).fit[0]
    # The file holds nine digits.
    for channel, values in motion().items():
        read = recording.time if channel == "time" else recording[channel]
        np.testing.assert_allclose(read, values, rtol=1e-8, atol=1e-12)


def test_degrees_and_microstrain_become_si(tmp_path):
    raw = motion()
    scaled = raw | {"hub_angle": np.degrees(raw["hub_angle"]), "strain_base": 1e6 * raw["strain_base"]}
    channels = CHANNELS | {
        "hub_angle": 'unit = "deg"\nnoise = 0.01',
        "strain_base": GAUGE.replace('"1"', '"microstrain"').replace("1e-6", "2"),
    }
    campaign = read_campaign(write(tmp_path, toml_text(channels, (FIT,)), push=scaled))
    np.testing.assert_allclose(campaign.fit[0]["hub_angle"], raw["hub_angle"], rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(campaign.fit[0]["strain_base"], raw["strain_base"], rtol=1e-7, atol=1e-12)
    assert campaign.sensors["hub_angle"].noise == pytest.approx(math.radians(0.01))
    assert campaign.sensors["strain_base"].noise == pytest.approx(2e-6)


def test_volts_become_si_through_gain_and_offset(tmp_path):
    raw = motion()
    volts = raw | {"pot": raw["hub_angle"] / -0.5 + 4.9}
    channels = CHANNELS | {
        "hub_angle": 'column = "pot"\nunit = "V"\ngain = -0.5\noffset = 4.9\nnoise = 0.002'
    }
    campaign = read_campaign(write(tmp_path, toml_text(channels, (FIT,)), push=volts))
    # Nine digits of 5 V.
    np.testing.assert_allclose(campaign.fit[0]["hub_angle"], raw["hub_angle"], atol=1e-7)
    assert campaign.sensors["hub_angle"].noise == pytest.approx(0.001)


def test_curvature_becomes_strain(tmp_path):
    raw = motion()
    bent = raw | {"strain_base": raw["strain_base"] / 0.001}
    channels = CHANNELS | {"strain_base": GAUGE.replace('"1"', '"1/m"').replace("1e-6", "1e-3")}
    campaign = read_campaign(write(tmp_path, toml_text(channels, (FIT,)), push=bent))
    np.testing.assert_allclose(campaign.fit[0]["strain_base"], raw["strain_base"], rtol=1e-7)
    assert campaign.sensors["strain_base"].noise == pytest.approx(1e-6)


def test_gain_in_the_unit_of_the_channel_corrects(tmp_path):
    channels = CHANNELS | {"hub_angle": f"{HUB}\ngain = 1.02\noffset = 0.1"}
    campaign = _read(tmp_path, channels=channels)
    expected = 1.02 * (motion()["hub_angle"] - 0.1)
    np.testing.assert_allclose(campaign.fit[0]["hub_angle"], expected, rtol=1e-7)


def test_gauge_position_and_half_thickness(tmp_path):
    sensor = _read(tmp_path).sensors["strain_base"]
    assert (sensor.position, sensor.half_thickness, sensor.noise) == (0.02, 0.001, 1e-6)


def test_a_gauge_in_curvature_needs_no_half_thickness(tmp_path):
    gauge = 'unit = "1/m"\nnoise = 1e-3\nposition = 0.02'
    columns = motion()
    curvature = columns["strain_base"] / 1e-3
    write(
        tmp_path,
        toml_text(CHANNELS | {"strain_base": gauge}, (FIT,)),
        push=columns | {"strain_base": curvature},
    )
    campaign = read_campaign(tmp_path)
    thickness = campaign.sensors["strain_base"].half_thickness
    assert campaign.sensors["strain_base"].noise == pytest.approx(1e-3 * thickness)
    np.testing.assert_allclose(campaign.fit[0]["strain_base"] / thickness, curvature, atol=1e-8)


@pytest.mark.parametrize(("inertia", "is_told"), [(0.05 * 0.4**2, True), (0.05 * 0.1**2, False)])
def test_the_inertia_of_a_payload_about_the_hub_is_suspected(tmp_path, inertia, is_told):
    payload = f"tip_mass = 0.05\ntip_inertia = {inertia}"
    toml = toml_text().replace("[parameters]\nlength = 0.4", f"[parameters]\nlength = 0.4\n{payload}")
    told = [
        w for w in read_campaign(write(tmp_path, toml)).warnings if "parameters.tip_inertia is 0.008" in w
    ]
    assert len(told) == is_told


def test_noise_left_unsaid(tmp_path):
    assert _read(tmp_path).sensors["torque_command"].noise is None


def test_noise_of_zero_is_left_unsaid_with_a_warning(tmp_path):
    campaign = _read(tmp_path, channels=CHANNELS | {"hub_angle": 'unit = "rad"\nnoise = 0.0'})
    assert campaign.sensors["hub_angle"].noise is None
    assert "channels.hub_angle.noise is 0" in campaign.warnings[0]


def test_channels_are_read_only(tmp_path):
    recording = _read(tmp_path).fit[0]
    with pytest.raises(ValueError, match="read-only"):
        recording["hub_angle"][0] = 0.0


# Time and missing samples


def test_jittered_time_with_gaps_stays_as_measured(tmp_path):
    raw = motion()
    jittered = raw | {"time": raw["time"] + 0.001 * np.random.default_rng(2).uniform(-1, 1, 500)}
    gappy = {name: np.delete(values, slice(100, 160)) for name, values in jittered.items()}
    recording = read_campaign(write(tmp_path, push=gappy)).fit[0]
    np.testing.assert_allclose(recording.time, gappy["time"], rtol=1e-8)


@pytest.mark.parametrize("empty", ["", "nan", "NaN", "  ", '""'])
def test_missing_samples_are_nan(tmp_path, empty):
    lines = csv_text(motion()).splitlines()
    for row in (1, 7, 8, 500):
        a, b, _, _ = lines[row].split(",")
        lines[row] = f"{a},{b},{empty},{empty}"
    recording = read_campaign(write(tmp_path, push="\n".join(lines))).fit[0]
    for channel in ("hub_angle", "strain_base"):
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(recording[channel])), [0, 6, 7, 499])


def test_missing_command_is_held(tmp_path):
    raw = motion()
    torque = raw["torque_command"].copy()
    torque[[0, 1, 50, 51]] = np.nan
    campaign = read_campaign(write(tmp_path, push=raw | {"torque_command": torque}))
    held = campaign.fit[0]["torque_command"]
    np.testing.assert_allclose(held[[0, 1, 50, 51]], raw["torque_command"][[2, 2, 49, 49]], rtol=1e-8)
    assert campaign.warnings == (
        "push.csv: torque_command is missing in 4 samples; the value before is held",
    )


def test_channel_missing_from_one_file(tmp_path):
    raw = motion()
    del raw["strain_base"]
    campaign = read_campaign(write(tmp_path, push=raw))
    assert "strain_base" not in campaign.fit[0]
    assert "strain_base" in campaign.holdout()[0]
    assert campaign.warnings == ()


def test_near_miss_of_a_column_is_noted(tmp_path):
    raw = motion()
    raw["strain_bsae"] = raw.pop("strain_base")
    campaign = read_campaign(write(tmp_path, push=raw))
    assert campaign.warnings == ("push.csv: there is no column 'strain_base'; did you mean 'strain_bsae'?",)


@pytest.mark.parametrize("columns", [("hub_angle",), ("hub_angle", "torque_command")])
def test_locked_hub_needs_neither_angle_nor_torque(tmp_path, columns):
    raw = {name: values for name, values in motion().items() if name not in columns}
    toml = toml_text(recordings=(f"{FIT}\nclamped = true", HELD_OUT))
    recording = read_campaign(write(tmp_path, toml, push=raw)).fit[0]
    assert "hub_angle" not in recording
    if "torque_command" in columns:
        np.testing.assert_array_equal(recording["torque_command"], 0.0)


def test_empty_reference_of_an_open_loop_is_absent(tmp_path):
    raw = motion() | {"hub_reference": np.full(500, np.nan)}
    campaign = read_campaign(
        write(tmp_path, toml_text(CHANNELS | {"hub_reference": 'unit = "rad"'}), push=raw)
    )
    assert "hub_reference" not in campaign.fit[0]


def test_other_columns_may_hold_anything(tmp_path):
    lines = csv_text(motion()).splitlines()
    text = "\n".join([f"{lines[0]},remark", *(f"{line},warm" for line in lines[1:])])
    assert len(read_campaign(write(tmp_path, push=text)).fit[0]) == 500


def test_time_column_by_another_name(tmp_path):
    raw = motion()
    renamed = {"t": raw.pop("time"), **raw}
    channels = {"time": 'column = "t"\nunit = "s"', **CHANNELS}
    campaign = read_campaign(write(tmp_path, toml_text(channels, (FIT,)), push=renamed))
    assert campaign.fit[0].time[1] == 0.004
    assert "time" not in campaign.sensors


@pytest.mark.parametrize(
    "change",
    [
        lambda text: b"\xef\xbb\xbf" + text.encode(),
        lambda text: text.replace("\n", "\r\n").encode(),
        lambda text: text.rstrip("\n").encode(),
        lambda text: text.encode() + b"\n\n",
        lambda text: text.replace(",", ", ").encode(),
        lambda text: text.replace("time", '"time"').encode(),
    ],
    ids=["byte-order mark", "CRLF", "no last newline", "empty last lines", "spaces", "quotes"],
)
def test_dialects_read_alike(tmp_path, change):
    recording = read_campaign(write(tmp_path, push=change(csv_text(motion())))).fit[0]
    np.testing.assert_allclose(recording["hub_angle"], motion()["hub_angle"], rtol=1e-8, atol=1e-12)


def test_byte_order_mark_and_crlf_in_toml(tmp_path):
    write(tmp_path)
    (tmp_path / "campaign.toml").write_bytes(b"\xef\xbb\xbf" + toml_text().replace("\n", "\r\n").encode())
    assert read_campaign(tmp_path).name == "small"


# The rig


def test_preset_leaves_uncertainty_unsaid(tmp_path):
    rig = _read(tmp_path, rig=PRESET, channels=CHANNELS | {"torque_command": 'unit = "N*m"'}).rig
    assert dict(rig) == dict(rigs.preset("bossi2009"))
    assert all(parameter.uncertainty is None for parameter in rig.parameters.values())


def test_campaign_overrides_preset(tmp_path):
    lines = f"{PRESET}\n[parameters]\ntip_mass = 0.2\n[uncertainty]\ntip_mass = 0.01\nlength = 0.002"
    parameters = _read(tmp_path, rig=lines).rig.parameters
    tip_mass, length = parameters["tip_mass"], parameters["length"]
    assert (tip_mass.value, tip_mass.uncertainty, tip_mass.source) == (0.2, 0.01, "campaign.toml")
    assert (length.value, length.uncertainty) == (0.42, 0.002)
    assert length.source == rigs.preset("bossi2009").parameters["length"].source
    assert parameters["hub_inertia"].uncertainty is None


def test_rig_without_preset_has_the_defaults(tmp_path):
    rig = _read(tmp_path).rig
    assert rig.name == "my-rig"
    assert rig["hub_inertia"] == 0.02
    for name in ("tip_mass", "tip_inertia", "static_friction", "coulomb_friction"):
        assert rig[name] == 0.0
    assert rig["torque_limit"] == math.inf
    assert rig["damping_ratio"] == 0.01
    assert rig.parameters["damping_ratio"].uncertainty == 1.0
    assert rig.parameters["length"].unit == "m"


def test_declared_damping_has_no_uncertainty_of_its_own(tmp_path):
    rig = _read(tmp_path, rig=f"{RIG}\ndamping_ratio = 0.02").rig
    assert rig.parameters["damping_ratio"].uncertainty is None


def test_integers_are_numbers(tmp_path):
    assert _read(tmp_path, rig=f"{RIG}\ntip_mass = 1").rig["tip_mass"] == 1.0


# The static load test


def test_static_test_comes_as_it_is(tmp_path):
    text = "tip_deflection,strain_volts\n0.028,-1.32\n0.022,\n"
    static = read_campaign(write(tmp_path, static=text)).static
    assert static is not None
    assert list(static.columns) == ["tip_deflection", "strain_volts"]
    np.testing.assert_array_equal(static["strain_volts"], [-1.32, np.nan])


def test_no_static_test(tmp_path):
    assert _read(tmp_path).static is None


# Sensors that hang


def test_stuck_gauge_is_missing_in_its_recording(tmp_path):
    stuck = motion() | {"strain_base": np.full(500, 3e-5)}
    campaign = read_campaign(write(tmp_path, push=stuck))
    assert np.isnan(campaign.fit[0]["strain_base"]).all()
    assert not np.isnan(campaign.holdout()[0]["strain_base"]).any()
    assert campaign.warnings == (
        "push.csv: strain_base stays at 3e-05 while the rig moves; taken as missing there",
    )


def test_hub_that_rests_below_its_static_friction_is_no_fault(tmp_path):
    # A ramp below the break-away torque: an angle in coarse steps never changes.
    rest = motion(peak=0.02) | {"hub_angle": np.full(500, 0.35)}
    campaign = read_campaign(write(tmp_path, toml_text(rig=f"{RIG}\nstatic_friction = 0.05"), push=rest))
    np.testing.assert_array_equal(campaign.fit[0]["hub_angle"], 0.35)
    assert campaign.warnings == ()


def test_locked_hub_that_never_turns_is_no_fault(tmp_path):
    locked = motion() | {"hub_angle": np.zeros(500)}
    toml = toml_text(recordings=(f"{FIT}\nclamped = true\ninitial_tip_deflection = 0.02",))
    assert read_campaign(write(tmp_path, toml, push=locked)).warnings == ()


def test_stuck_hub_angle_is_missing_in_its_recording(tmp_path):
    stuck = motion() | {"hub_angle": np.full(500, 0.35)}
    campaign = read_campaign(write(tmp_path, push=stuck))
    assert np.isnan(campaign.fit[0]["hub_angle"]).all()
    assert "push.csv: hub_angle stays at 0.35 rad" in campaign.warnings[0]


# Cost


def test_import_is_light():
    code = (
        "import sys; before = set(sys.modules); import twin.campaigns.campaign;"
        "heavy = {'pandas', 'pint', 'mujoco', 'numba', 'control', 'plotly', 'rerun'} & set(sys.modules);"
        "assert not heavy, heavy"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_eight_recordings_read_within_a_second(tmp_path):
    names = [f"run{i}" for i in range(8)]
    every = [motion(samples=5000, peak=0.01, seed=seed) for seed in range(8)]
    texts = [csv_text(raw | {f"spare{i}": raw["hub_angle"] for i in range(3)}) for raw in every]
    toml = toml_text(recordings=tuple(f'file = "{name}.csv"\nrole = "fit"' for name in names))
    write(tmp_path, toml, **dict(zip(names, texts, strict=True)))
    start = time.perf_counter()
    read_campaign(tmp_path)
    # 0.06 s on one core of 2020; the rest is for a busy machine.
    assert time.perf_counter() - start < 1.0
