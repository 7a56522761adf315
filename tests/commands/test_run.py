"""Experiments: the paper's scenarios on both plants, as files, in rerun, in MuJoCo's viewer, and compared."""

import json
import math
import re
import sys
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rrd import contents, read

from twin.control import scenarios
from twin.control.experiment import Experiment
from twin.control.plants import make_model
from twin.errors import InputError
from twin.report import run_rerun
from twin.report.compare import compare, read_tracks
from twin.report.mujoco_viewer import watch
from twin.report.run_files import read_track, write_run
from twin.report.show_run import ghost_track, run_and_show
from twin.rigs import preset
from twin.rigs.rig_file import header_lines, parameter_lines

RIG = preset("bossi2009")


def experiment(name="lq-step-120", plant="compiled", **more) -> Experiment:
    return Experiment(name, plant, RIG, {}, **more)


@pytest.fixture(scope="module")
def chain_run():
    return experiment(plant="chain").run()


def rig_file(path: Path, backlash: bool = False, **values: float) -> None:
    """Writes a parameter file of the rig with other values."""
    effect = ["", "[effects.backlash]", "gap = 0.01"] if backlash else []
    lines = chain.from_iterable(parameter_lines(p) for p in RIG.replace(**values).parameters.values())
    path.write_text(
        "\n".join([*header_lines("mine", "for a test"), *lines, *effect]) + "\n", encoding="utf-8"
    )


# The paper's figures: Bossi et al. 2009, section VI


def test_lq_step_ends_where_the_paper_measured(chain_run):
    assert scenarios.metrics(chain_run)["hub_final_deg"] == pytest.approx(121.1, abs=1.0)


@pytest.mark.parametrize("plant", ["compiled", "modal", "paper"])
def test_slow_sinusoid_has_the_amplitude_of_figure_5(plant):
    figures = experiment("sinus-0.2", plant).metrics(experiment("sinus-0.2", plant).run())
    assert (figures["hub_max_deg"] - figures["hub_min_deg"]) / 2 == pytest.approx(44.6, abs=1.0)
    # The figure's peaks are those of the paper's friction, which holds the hub against its motor alone.
    as_published = plant == "paper"
    assert (figures["peak_deflection_mm"] == pytest.approx(18, abs=3)) == as_published
    assert (figures["peak_torque_nm"] == pytest.approx(0.067, abs=0.01)) == as_published
    assert (figures["stuck_fraction"] > 0.3) != as_published


@pytest.mark.parametrize(
    ("degrees", "published"), [(20, 18.84), (45, 42.70), (60, 58.25), (90, 85.00), (120, 112.00)]
)
def test_bang_bang_turns_the_papers_model_as_its_own_simulation_did(degrees, published):
    shown = experiment(f"bang-bang-{degrees}", "paper")
    assert shown.metrics(shown.run())["hub_final_deg"] == pytest.approx(published, abs=1.1)


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["compiled", "modal", "paper"])
def test_fast_sinusoid_has_the_amplitude_and_deflection_of_figure_6(plant):
    figures = experiment("sinus-0.4", plant).metrics(experiment("sinus-0.4", plant).run())
    assert (figures["hub_max_deg"] - figures["hub_min_deg"]) / 2 == pytest.approx(55.0, abs=1.5)
    # The modal plant's 58.03 mm are 4 mm more than the figure, the chain's 57.4 and the paper's model's 55.2 less.
    assert figures["peak_deflection_mm"] == pytest.approx(54, abs=4.1 if plant == "modal" else 4.0)
    assert figures["saturated_fraction"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [20, 45, 60, 90, 120])
def test_bang_bang_turns_the_rigid_rig_without_friction_by_its_angle(degrees):
    stiff = RIG.replace(
        bending_stiffness=2000.0, static_friction=0.0, coulomb_friction=0.0, damping_ratio=0.3
    )
    name = f"bang-bang-{degrees}"
    figures = scenarios.metrics(Experiment(name, "modal", stiff, {}).run())
    assert figures["hub_final_deg"] == pytest.approx(degrees, rel=2e-3)
    assert figures["peak_torque_nm"] <= scenarios.BANG_BANG_TORQUE


def test_filtered_step_is_followed_alike_by_both_plants():
    chain, modal = (experiment("filtered-step-120", plant).run() for plant in ("compiled", "modal"))
    difference = np.degrees(chain.true["hub_angle"] - modal.true["hub_angle"])
    assert np.sqrt(np.mean(difference**2)) < 0.01 * 120
    assert np.degrees(chain.true["hub_angle"][-1]) == pytest.approx(120, abs=10)


def test_noise_is_read_and_not_true():
    noisy = experiment(noise=1).run()
    error = noisy.measured["hub_angle"] - noisy.true["hub_angle"]
    assert 2e-4 < error.std() < 5e-4


# Files


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".parquet", ".mcap"])
def test_a_run_is_read_back_as_the_recording_it_is(tmp_path, chain_run, suffix):
    pytest.importorskip({".parquet": "pyarrow", ".mcap": "mcap"}.get(suffix, "scipy"))
    write_run(chain_run, tmp_path / f"run{suffix}")
    track = read_track(tmp_path / f"run{suffix}")
    np.testing.assert_allclose(
        track.channels["hub_angle"], chain_run.true["hub_angle"], rtol=1e-8, atol=1e-12
    )
    np.testing.assert_array_equal(track.modes, chain_run.modes)
    assert set(track.states) == set(chain_run.states)


def test_a_campaign_reads_what_a_run_wrote(tmp_path, chain_run):
    from twin.campaigns.campaign import read_campaign

    write_run(chain_run, tmp_path / "run.csv")
    units = {"torque_command": "N*m", "hub_angle": "rad", "tip_deflection": "m"}
    channels = "".join(f'[channels.{name}]\nunit = "{unit}"\n' for name, unit in units.items())
    recordings = '[[recordings]]\nfile = "run.csv"\nrole = "fit"\n'
    (tmp_path / "campaign.toml").write_text(
        f'format = 1\nname = "own"\nrig = "bossi2009"\n{channels}{recordings}', encoding="utf-8"
    )
    recording = read_campaign(tmp_path).fit[0]
    np.testing.assert_allclose(recording["hub_angle"], chain_run.true["hub_angle"], atol=1e-8)


def test_rerun_file_holds_the_run_and_its_ghost(tmp_path):
    path = tmp_path / "run.rrd"
    shown = experiment(plant="chain", noise=None)
    result = run_and_show(shown, path, view=False, ghost="other")
    found = read(path)
    for entity in (
        "/run/arms/0_chain/link",
        "/run/arms/1_modal/link",
        "/run/arms/fork",
        "/run/hub_angle/0_chain",
        "/run/hub_angle/1_modal",
        "/run/hub_angle/reference",
        "/run/tip_deflection/0_chain",
        "/run/strain_base/0_chain",
        "/run/torque/command",
        "/run/torque/limit_upper",
        "/run/friction/mode",
        "/run/controller/integral",
        "/run/difference_hub_angle/1_modal",
    ):
        assert found[entity]["sim_time"][0] == pytest.approx(0.0, abs=0.02)
        assert found[entity]["sim_time"][-1] == pytest.approx(5.0, abs=0.02)
    hub = np.concatenate(list(found["/run/hub_angle/0_chain"]["scalars"]))
    np.testing.assert_allclose(hub, np.degrees(result.true["hub_angle"]), atol=1e-9)
    tips = np.array(
        [positions[0] for positions in found["/run/arms/0_chain/payload"]["positions"]], dtype=float
    )
    assert np.abs(tips[-1][:2] - result.outline[-1, -1]).max() < 0.42 * 0.02
    assert len(tips) == pytest.approx(5 * 60, abs=3)


def test_what_is_sent_while_a_run_goes_on_is_what_the_file_holds(tmp_path, monkeypatch):
    live, path = tmp_path / "live.rrd", tmp_path / "run.rrd"
    stream = rr.RecordingStream("live")
    stream.save(live)
    monkeypatch.setattr(run_rerun, "open_viewer", lambda name: stream)
    run_and_show(experiment(noise=1), path, view=True, ghost="other")
    streamed, written = read(live), read(path)
    assert streamed.keys() == written.keys()
    assert {"/run/difference_hub_angle/1_modal", "/run/difference_tip_deflection/1_modal"} < written.keys()
    for entity, columns in written.items():
        order = np.argsort(streamed[entity]["sim_time"], kind="stable")
        np.testing.assert_allclose(streamed[entity]["sim_time"][order], columns["sim_time"], atol=1e-9)
        if "scalars" in columns:
            there = np.concatenate([streamed[entity]["scalars"][i] for i in order])
            np.testing.assert_allclose(there, np.concatenate(list(columns["scalars"])), atol=1e-12)


def test_the_same_run_gives_the_same_recording(chain_run, tmp_path):
    track = run_rerun.of_run(chain_run, "chain")
    for name in ("a.rrd", "b.rrd"):
        run_rerun.write_rrd([track], RIG["length"], tmp_path / name, "run")
    assert contents(tmp_path / "a.rrd") == contents(tmp_path / "b.rrd")


@pytest.mark.slow
def test_where_the_modal_model_has_no_such_effect_it_is_said_that_no_ghost_is_shown(twin, tmp_path):
    rig_file(tmp_path / "rig.toml", backlash=True)
    code, out, _ = twin("run", "lq-step-120", "--rig", "rig.toml", "--rrd", "run.rrd")
    assert code == 0
    assert "No ghost is shown: effect backlash has no place in the modal plant." in out
    assert not any("modal" in entity for entity in read(tmp_path / "run.rrd"))


IMPOSSIBLE = {
    "lag": (
        "[effects.actuator-lag]\ntime_constant = -5",
        "actuator-lag.time_constant is -5 s; expected 0 to 10",
    ),
    "mass": (
        "[effects.payload-mass]\ntip_mass = -5",
        "effects.payload-mass.tip_mass is -5 kg; expected 0 to 1000 kg",
    ),
    "clamp": (
        "[effects.root-compliance]\nstiffness = -1e9",
        "stiffness is -1e+09 N*m/rad; expected a number >= 0.001",
    ),
    "gap": (
        "[effects.backlash]\ngap = 1" + 400 * "0",
        "effects.backlash.gap is beyond the largest number",
    ),
}


@pytest.mark.parametrize(("effect", "message"), IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_an_effect_that_no_rig_can_have_is_one_message(twin, tmp_path, effect, message):
    rig_file(tmp_path / "rig.toml")
    with (tmp_path / "rig.toml").open("a") as file:
        file.write(f"\n{effect}\n")
    code, out, errors = twin("run", "lq-step-120", "--rig", "rig.toml")
    assert (code, out) == (2, "")
    assert errors.startswith("Error: rig.toml: ")
    assert errors.count("\n") == 1
    assert message in errors


def test_a_rig_that_cannot_be_simulated_is_one_message(twin, tmp_path):
    rig_file(tmp_path / "rig.toml", bending_stiffness=1e6)
    code, _, errors = twin("run", "lq-step-120", "--rig", "rig.toml")
    assert code == 2
    assert "vibrates too fast" in errors


def test_gauges_are_on_the_link_of_a_short_rig():
    gauges = make_model(preset("bossi2009").replace(length=0.15), segments=4).sensors
    assert gauges["strain_mid"].position == pytest.approx(0.075)
    assert gauges["strain_base"].position == pytest.approx(0.02 * 0.15 / 0.42)
    assert make_model(preset("bossi2009"), segments=4).sensors["strain_mid"].position == 0.21


def test_a_run_that_diverges_is_one_message_and_leaves_no_file(twin, tmp_path):
    rig_file(tmp_path / "rig.toml")
    with (tmp_path / "rig.toml").open("a") as file:
        file.write("\n[effects.torque-bias]\nbias = 500.0\n")
    code, _, errors = twin("run", "lq-step-120", "--rig", "rig.toml")
    assert code == 2
    assert "the chain diverged at 0.004 s" in errors
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]  # no MUJOCO_LOG.TXT


def test_pieces_of_a_run_are_the_run():
    pieces = []
    whole = experiment().run(pieces.append)
    assert len(pieces) == pytest.approx(10, abs=1)
    for name in ("hub_angle", "tip_deflection"):
        np.testing.assert_array_equal(np.concatenate([p.true[name] for p in pieces]), whole.true[name])


# Compared


def test_difference_of_two_runs_is_measured(tmp_path, chain_run):
    write_run(chain_run, tmp_path / "a.csv")
    write_run(experiment(plant="modal").run(), tmp_path / "b.csv")
    same, *_ = compare(read_tracks([tmp_path / "a.csv", tmp_path / "a.csv"]))
    assert same.rms == 0.0
    rows = {r.channel: r for r in compare(read_tracks([tmp_path / "a.csv", tmp_path / "b.csv"]))}
    assert 0 < rows["hub_angle"].relative < 0.02
    assert rows["hub_angle"].largest >= rows["hub_angle"].rms


def test_files_of_one_name_are_told_apart(tmp_path, chain_run):
    paths = [tmp_path / folder / "run.csv" for folder in ("first", "second")]
    for path in paths:
        path.parent.mkdir()
        write_run(chain_run, path)
    assert [track.name for track in read_tracks(paths)] == [str(path) for path in paths]


def test_runs_are_drawn_with_length_and_limit_of_their_rig(twin, tmp_path, chain_run):
    rig_file(tmp_path / "long.toml", length=0.84, torque_limit=0.5)
    for name in ("a.csv", "b.csv"):
        write_run(chain_run, tmp_path / name)
    assert twin("compare", "a.csv", "b.csv", "--rig", "long.toml", "--rrd", "run.rrd")[0] == 0
    found = read(tmp_path / "run.rrd")
    tip = found["/run/arms/0_a.csv/payload"]["positions"][0][0]
    assert np.hypot(tip[0], tip[1]) == pytest.approx(0.84, rel=1e-3)
    assert found["/run/torque/limit_upper"]["scalars"][0][0] == 0.5


def test_what_is_not_alike_is_said_in_a_sentence_and_numbers_are_readable(twin, tmp_path, chain_run):
    write_run(chain_run, tmp_path / "a.csv")
    write_run(experiment("sinus-0.2", plant="modal").run(), tmp_path / "b.csv")
    code, out, _ = twin("compare", "a.csv", "b.csv")
    assert code == 0
    assert "b.csv lasts 20 s, a.csv 5 s" in out
    assert "b.csv is of another experiment than a.csv" in out
    assert "e+" not in out
    rows = [line.rstrip() for line in out.splitlines() if line.rstrip().endswith(" %")]
    assert len(rows) == 5
    assert len({len(line) for line in rows}) == 1
    write_run(experiment(plant="modal").run(), tmp_path / "b.csv")
    out = twin("compare", "a.csv", "b.csv")[1]
    assert "lasts" not in out
    assert "another experiment" not in out


def test_one_file_is_nothing_to_compare(tmp_path):
    with pytest.raises(InputError, match="expected two or more"):
        read_tracks([tmp_path / "a.csv"])


def written(rows) -> str:
    return "\n".join(["\ufefftime,hub_angle", *(f"{t},{y}" for t, y in rows)])


SMOOTH = [(round(0.01 * k, 2), round(0.001 * k, 3)) for k in range(300)]
TIMES = {
    "a ring buffer": (SMOOTH[150:] + SMOOTH[:150], "bad.csv, line 152: time is 0 after 2.99;"),
    "no samples": ([], "bad.csv has no samples after its header; expected at least 2"),
    "one sample": (SMOOTH[:1], "bad.csv has one sample after its header; expected at least 2"),
    "a missing instant": ([("nan", 0), *SMOOTH[1:]], "bad.csv, line 2: time is missing; expected a number"),
    "milliseconds": ([(1000 * t, y) for t, y in SMOOTH], "is it in milliseconds? Convert it to s"),
    "a clock that was set": ([*SMOOTH, (1.7e9, 0)], "bad.csv, line 302: time is 1700000000 after 2.99;"),
}


@pytest.mark.parametrize(("rows", "message"), TIMES.values(), ids=TIMES)
def test_the_time_of_a_run_is_checked_as_that_of_a_campaign(tmp_path, rows, message):
    (tmp_path / "good.csv").write_text(written(SMOOTH), encoding="utf-8")
    (tmp_path / "bad.csv").write_text(written(rows), encoding="utf-8")
    for names in (("good.csv", "bad.csv"), ("bad.csv", "good.csv")):
        with pytest.raises(InputError, match=re.escape(message)):
            read_tracks([tmp_path / name for name in names])
    with pytest.raises(InputError, match=re.escape(message)):
        ghost_track(experiment(), str(tmp_path / "bad.csv"))


def test_what_is_no_table_is_refused_as_such(twin, tmp_path):
    (tmp_path / "a.json").write_text("{}")
    (tmp_path / "b.csv").write_text("time,hub_angle\n0,1\n1,2\n")
    (tmp_path / "law.bin").write_bytes(b"\x00\xff")
    for arguments, message in (
        (("compare", "a.json", "b.csv"), "a.json is no run; expected a file"),
        (("run", "lq-step-120", "--rig", "."), ". is a folder; expected a rig as a TOML file"),
        (("run", "lq-step-120", "--rig", "b.csv"), "expected a rig as TOML"),
        (("run", "lq-step-120", "--rig", "law.bin"), "law.bin, line 1: byte 0xff is not UTF-8"),
    ):
        code, out, error = twin(*arguments)
        assert (code, out) == (2, "")
        assert message in error


def test_the_help_of_validate_has_every_scenario_that_comes_to_rest(twin):
    said = twin("validate", "--help")[1]
    for name in scenarios.SCENARIOS:
        assert (name.rpartition("-")[2] in said) == (not name.startswith("sinus"))


def test_a_file_without_channels_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text("t,x\n0,1\n1,2\n")
    with pytest.raises(InputError, match="expected time and hub_angle"):
        read_track(tmp_path / "a.csv")


# The viewer


def test_viewer_shows_the_moving_chain_in_real_time():
    class Window:
        def __init__(self, model, data):
            self.data, self.angles, self.open = data, [], True

        def is_running(self):
            return len(self.angles) < 60

        def sync(self):
            self.angles.append(float(self.data.qpos[0]))

        def close(self):
            self.open = False

    opened, slept = [], []

    def open_window(model, data):
        opened.append(Window(model, data))
        return opened[0]

    watch(experiment(plant="chain"), open_window, clock=lambda: 0.0, sleep=slept.append)
    assert not opened[0].open
    assert len(opened[0].angles) == 60
    assert opened[0].angles[-1] == pytest.approx(math.radians(98), abs=0.3)
    assert slept[-1] == pytest.approx(1.0, abs=0.05)


# The command


def test_command_prints_and_writes_what_others_rely_on(twin, tmp_path):
    code, out, _ = twin("run", "lq-step-120", "--plant", "modal", "--json", "a.json", "--csv", "a.csv")
    assert code == 0
    answer = json.loads((tmp_path / "a.json").read_text())
    assert {*answer} == {"scenario", "plant", "controller", "duration_s", "wall_s", "metrics"}
    assert answer["controller"] == "lqi"
    assert answer["duration_s"] == pytest.approx(5.0)
    assert {*answer["metrics"]} == {
        "hub_final_deg",
        "hub_min_deg",
        "hub_max_deg",
        "peak_deflection_mm",
        "peak_torque_nm",
        "saturated_fraction",
        "stuck_fraction",
    }
    rows = [re.split(r"  +", line.strip()) for line in out.splitlines()]
    end, stuck = answer["metrics"]["hub_final_deg"], answer["metrics"]["stuck_fraction"]
    assert ["hub angle at the end", f"{end:.1f}", "°"] in rows
    assert ["time in which the hub sticks", f"{100 * stuck:.2f}", "%"] in rows
    assert "_" not in out.replace("a.json", "")
    assert ["run", "a.csv"] in rows
    assert ["JSON", "a.json"] in rows


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "lq-step-12"], "did you mean 'lq-step-120'"),
        (["run", "lq-step-120", "--plant", "chian"], "did you mean 'chain'"),
        (["run", "lq-step-120", "--controller", "mine.py:make"], "mine.py: no such file"),
        (["run", "lq-step-120", "--rig", "bosi2009"], "did you mean 'bossi2009'"),
        (["run", "lq-step-120", "--csv", "nowhere/run.csv"], "there is no folder nowhere"),
        (["run", "lq-step-120", "--ghost", "other"], "expected --rrd FILE or --view with it"),
        (["run", "lq-step-120", "--ghost", "twin", "--rrd", "a.rrd"], "is no ghost"),
        (["compare", "a.csv"], "expected two or more"),
        (["compare", "a.csv", "b.csv"], "a.csv"),
    ],
)
def test_bad_input_is_one_message_and_nothing_is_written(twin, tmp_path, arguments, message):
    code, out, err = twin(*arguments)
    assert code == 2
    assert err.startswith("Error: ")
    assert message in err
    assert not out
    assert not list(tmp_path.iterdir())


def test_a_negative_seed_is_refused(twin, tmp_path):
    code, out, err = twin("run", "lq-step-120", "--noise", "-1")
    assert (code, out) == (2, "")
    assert "Error: Invalid value for '--seed'" in err


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere there is always a display")
@pytest.mark.parametrize("display", [None, ":4711"])
@pytest.mark.parametrize("arguments", [["view"], ["run", "lq-step-120", "--view"]])
def test_without_a_display_it_says_so(twin, monkeypatch, arguments, display):
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    if display is not None:
        monkeypatch.setenv("DISPLAY", display)
    code, out, err = twin(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("Error: ")
    assert "needs a display" in err
    assert err.count("\n") == 1


# The rerun viewer


@pytest.mark.skipif(sys.platform == "win32", reason="scripts of POSIX")
def test_the_viewer_beside_the_interpreter_is_started(monkeypatch, tmp_path):
    import rerun as rr

    viewer = tmp_path / "rerun"
    viewer.write_text("#!/bin/sh")
    viewer.chmod(0o755)
    asked = []
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setattr(rr, "spawn", lambda **options: asked.append(options["executable_path"]))
    run_rerun.open_viewer("run")
    assert asked == [str(viewer)]


def test_a_viewer_that_does_not_start_is_said_in_one_line(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(InputError, match=r"viewer cannot be started: Failed to find [^\n]*$"):
        run_rerun.open_viewer("run")
