"""The rerun recording, read back: arms, channels, unmodelled torque, their times and values."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic_diagnosis as synthetic
from rrd import contents, layout, read

from twin.recording import Recording, Sensor
from twin.report import display
from twin.report.diagnosis_rerun import _summary, to_rrd
from twin.report.rerun_parts import centre_line

LENGTH = 0.42


def write_rrd(diagnosis, path, sensors=None):
    path.write_bytes(to_rrd(diagnosis, sensors))


@pytest.fixture(scope="module")
def diagnosis():
    return synthetic.diagnosis(duration=1.0)


@pytest.fixture(scope="module")
def written(diagnosis, tmp_path_factory):
    path = tmp_path_factory.mktemp("rerun") / "diagnosis.rrd"
    write_rrd(diagnosis, path, synthetic.SENSORS)
    return read(path)


def test_three_arms_move_over_the_whole_recording(diagnosis, written):
    duration = diagnosis.predictions["bang-bang-90.csv"].measured.duration
    for model in ("measured", "simulated/before", "simulated/after"):
        arm = written[f"/holdout/01_bang-bang-90/arms/{model}/link"]
        assert arm["sim_time"][0] == 0.0
        assert arm["sim_time"][-1] == pytest.approx(duration, abs=1 / 60)
        assert len(arm["sim_time"]) == pytest.approx(60 * duration, abs=2)


def test_tip_is_where_the_link_ends(written):
    arm = "/holdout/01_bang-bang-90/arms/measured"
    tip = np.array(list(written[f"{arm}/payload"]["positions"]), dtype=float)[:, 0]
    ends = np.array([strips[0][-1] for strips in written[f"{arm}/link"]["strips"]], dtype=float)
    assert tip == pytest.approx(ends)
    assert np.linalg.norm(tip[:, :2], axis=1).max() <= LENGTH + 1e-6


def test_scalars_are_degrees_and_microstrain(diagnosis, written):
    after = diagnosis.predictions["bang-bang-90.csv"].after
    for channel, factor in (("hub_angle", 180 / np.pi), ("strain_base", 1e6)):
        series = written[f"/holdout/01_bang-bang-90/{channel}/simulated/after"]
        values = np.array([v[0] for v in series["scalars"]])
        assert values == pytest.approx(factor * after[channel])
        assert series["sim_time"] == pytest.approx(after.time, abs=1e-9)


def test_an_unknown_zero_is_in_no_residual(diagnosis, tmp_path):
    file = "bang-bang-90.csv"
    zeros = {"before": {"strain_base": 1e-5}, "after": {"strain_base": 3e-5}}
    changed = replace(diagnosis.predictions[file], zeros=zeros)
    off = replace(diagnosis, predictions={file: changed})
    write_rrd(off, tmp_path / "zero.rrd")
    sent = read(tmp_path / "zero.rrd")
    for model, zero in (("before", 10), ("after", 30)):
        bare = 1e6 * getattr(changed, model)["strain_base"]
        left, shown = (
            np.array([v[0] for v in sent[f"/holdout/01_bang-bang-90/{place}"]["scalars"]])
            for place in (f"residuals/strain_base/{model}", f"strain_base/simulated/{model}")
        )
        assert shown == pytest.approx(bare + zero)
        assert left == pytest.approx(1e6 * changed.measured["strain_base"] - bare - zero)
    assert "The zero of the base strain is unknown" in _summary(off)


def test_unmodelled_torque_is_that_of_each_recording(diagnosis, written):
    trace = diagnosis.traces[0]
    second = trace.recording == 1
    series = written["/fit/04_bang-bang-45/unmodelled/estimated"]
    assert np.array([v[0] for v in series["scalars"]]) == pytest.approx(trace.values[second])
    assert series["sim_time"][0] == 0.0
    assert "/fit/04_bang-bang-45/arms/unmodelled_torque" in written
    unseen = diagnosis.predictions["bang-bang-90.csv"].torque
    series = written["/holdout/01_bang-bang-90/unmodelled/fitted"]
    known = np.isfinite(unseen.values)
    assert np.array([v[0] for v in series["scalars"]]) == pytest.approx(unseen.fitted[known])
    assert "/holdout/01_bang-bang-90/arms/unmodelled_torque" in written
    # With the hub locked there is no torque balance.
    assert not [e for e in written if e.startswith("/holdout/02_release") and "unmodelled" in e]


def test_residuals_stand_beside_each_channel(diagnosis, written):
    p = diagnosis.predictions["bang-bang-90.csv"]
    for model in ("before", "after"):
        series = written[f"/holdout/01_bang-bang-90/residuals/strain_base/{model}"]
        left = 1e6 * (p.measured["strain_base"] - getattr(p, model)["strain_base"])
        assert np.array([v[0] for v in series["scalars"]]) == pytest.approx(left)


def test_plots_of_a_recording_share_its_time_window(diagnosis, tmp_path):
    write_rrd(diagnosis, tmp_path / "x.rrd")
    told = layout(tmp_path / "x.rrd")
    # Three channels and what is left of each, command and unmodelled torque; with a locked hub two, and the command.
    assert told.count("TimeAxis:view_range") >= 3 * 8 + 2 * 5
    assert "hub angle: measured − simulated [°]" in told


def test_summary_has_the_caveat(diagnosis):
    assert display.caveat(diagnosis) in _summary(diagnosis)
    assert "cable torsion**: stiffness 0.0101 ± 0.0003 N·m/rad, rest angle" in _summary(diagnosis)


def test_nothing_missing_has_no_arrow(diagnosis, tmp_path):
    write_rrd(
        replace(diagnosis, verdict="no-missing-effect", effects=()), tmp_path / "null.rrd", synthetic.SENSORS
    )
    found = read(tmp_path / "null.rrd")
    assert "/fit/04_bang-bang-45/unmodelled/estimated" in found
    assert not [e for e in found if e.endswith("unmodelled_torque")]


def test_torque_of_a_recording_that_begins_with_a_rest_comes_when_it_acts(diagnosis, tmp_path):
    """A clock that does not start at zero; 0.3 s of rest, a rest of 0.2 s later on: no torque is known in them."""
    p, trace = diagnosis.predictions["bang-bang-45.csv"], diagnosis.traces[0]
    shifted = {m: (r := getattr(p, m)).replace(time=r.time + 5.0) for m in ("measured", "before", "after")}
    within = trace.since_start
    moves = (trace.recording == 0) | (within >= 0.3) & ((within < 0.6) | (within >= 0.8))
    parts = {n: getattr(trace, n)[moves] for n in ("time", "values", "recording", "since_start", "fitted")}
    late = replace(trace, variables={n: v[moves] for n, v in trace.variables.items()}, **parts)
    predictions = {**diagnosis.predictions, "bang-bang-45.csv": replace(p, **shifted)}
    write_rrd(replace(diagnosis, predictions=predictions, traces=(late,)), tmp_path / "late.rrd")
    found = read(tmp_path / "late.rrd")
    series = found["/fit/04_bang-bang-45/unmodelled/fitted"]
    assert series["sim_time"] == pytest.approx(5.0 + within[moves & (trace.recording == 1)], abs=1e-9)
    arrow = found["/fit/04_bang-bang-45/arms/unmodelled_torque"]
    long = np.array([len(vectors) > 0 for vectors in arrow["vectors"]])
    frames = arrow["sim_time"] - 5.0
    moving = (frames >= 0.3) & ((frames <= 0.596) | (frames >= 0.8)) & (frames <= within[-1])
    assert long.tolist() == moving.tolist()


def test_clamped_recording_has_arms_but_no_hub_angle(written):
    entities = [e for e in written if e.startswith("/holdout/02_release")]
    assert "/holdout/02_release/arms/measured/link" in entities
    assert not [e for e in entities if "hub_angle" in e]


@pytest.mark.parametrize("make", [synthetic.outside, synthetic.nothing_missing])
def test_other_verdicts_odd_names_and_no_sensors(make, tmp_path):
    diagnosis = make(duration=0.4)
    names = {"../ü [odd] name\n.csv": "bang-bang-90.csv", "/": "multisine.csv"}
    odd = replace(diagnosis, predictions={k: diagnosis.predictions[v] for k, v in names.items()})
    write_rrd(odd, tmp_path / "odd.rrd")
    assert {e.split("/")[1] for e in read(tmp_path / "odd.rrd")} == {"holdout", "fit"}


def test_lost_channels_leave_the_arm_straight(tmp_path):
    diagnosis = synthetic.diagnosis(duration=0.4)
    p = diagnosis.predictions["bang-bang-90.csv"]
    lost = {name: np.full(len(p.measured), np.nan) for name in p.measured.channels}
    blind = replace(p, measured=p.measured.replace(channels=lost))
    write_rrd(replace(diagnosis, predictions={"x.csv": blind}), tmp_path / "x.rrd", synthetic.SENSORS)
    strips = read(tmp_path / "x.rrd")["/holdout/01_x/arms/measured/link"]["strips"]
    assert np.array(strips[0][0], dtype=float)[:, 1] == pytest.approx(0.0)


def test_the_same_diagnosis_gives_the_same_recording_and_another_one_another(tmp_path, monkeypatch):
    diagnosis = synthetic.diagnosis(duration=0.4)
    p = diagnosis.predictions["bang-bang-90.csv"]
    moved = p.after.replace(channels={**p.after.channels, "hub_angle": p.after["hub_angle"] + 1e-6})
    other = {**diagnosis.predictions, "bang-bang-90.csv": replace(p, after=moved)}
    write_rrd(diagnosis, tmp_path / "a.rrd", synthetic.SENSORS)
    monkeypatch.setenv("RERUN", "off")
    write_rrd(replace(diagnosis, wall_s=1.0), tmp_path / "b.rrd", synthetic.SENSORS)
    write_rrd(replace(diagnosis, predictions=other), tmp_path / "c.rrd", synthetic.SENSORS)
    a, b, c = (contents(tmp_path / f"{name}.rrd") for name in "abc")
    assert a == b
    assert len(a) > 10
    assert a[0] != c[0]


# The line of the link, from gauges


def _line(sensors=synthetic.SENSORS, **channels) -> np.ndarray:
    recording = Recording("x", np.array([0.0]), {name: np.array([v]) for name, v in channels.items()})
    return centre_line(recording, np.array([0.0]), LENGTH, sensors)[0]


def test_straight_link_points_along_the_hub_angle():
    assert _line(hub_angle=np.pi / 2)[-1] == pytest.approx([0.0, LENGTH], abs=1e-12)


def test_tip_force_bends_the_link_as_a_cantilever():
    # w'' = kappa (1 - x/l) is linear and zero at the tip: w(l) = kappa l^2 / 3, small deflections.
    kappa = 0.02
    strains = {
        name: 0.001 * kappa * (1 - synthetic.SENSORS[name].position / LENGTH)
        for name in ("strain_base", "strain_mid")
    }
    # 24 points and the trapezoidal rule: 0.1 %
    assert _line(hub_angle=0.0, **strains)[-1, 1] == pytest.approx(kappa * LENGTH**2 / 3, rel=2e-3)


def test_one_gauge_is_enough():
    alone = {"strain_base": synthetic.SENSORS["strain_base"]}
    assert _line(alone, hub_angle=0.0, strain_base=1e-4)[-1, 1] > 0
    tip = {"strain_base": Sensor("strain_base", position=LENGTH, half_thickness=0.001)}
    assert _line(tip, hub_angle=0.0, strain_base=1e-4)[-1, 1] == 0.0
