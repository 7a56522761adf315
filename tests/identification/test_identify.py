"""`twin identify`: each procedure against planted values, then all of them on one campaign."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace

import browser
import campaign_folder
import numpy as np
import pytest
from scipy.constants import g
from scipy.signal import cont2discrete, lfilter, sosfiltfilt
from typer.testing import CliRunner

from twin import cli
from twin.campaigns import campaign
from twin.campaigns.campaign import read_campaign
from twin.errors import InputError
from twin.estimation.calibrate import noise_levels
from twin.identification import (
    as_json,
    break_away,
    decay,
    findings,
    friction_map,
    pictures,
    spectra,
    static_line,
    static_test,
)
from twin.identification.backbone import Backbone, backbone
from twin.identification.break_away import StaticFriction
from twin.identification.deliver import FOLDER
from twin.identification.estimates import Estimate, Mode, normalised_difference, pooled
from twin.mechanics import beam, chain
from twin.mechanics.state import Start
from twin.recording import Recording, Sensor
from twin.residuals.data import DrivenData
from twin.residuals.prepared import Prepared, prepare
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.rig_file import effect_lines, header_lines, parameter_lines, read_rig_file
from twin.rigs.simulate import simulate
from twin.virtual_rig import UNCERTAINTY, Rig, Sensors
from twin.virtual_rig.experiments import Experiment, free_release

# Bossi et al. 2009, Table I: masses on the plate [kg], displacements [m]; length from Table II [m].
MASSES = np.array([0.005, 0.010, 0.015, 0.020, 0.025])
DISPLACEMENTS = np.array([0.023, 0.029, 0.034, 0.039, 0.044])
LENGTH = Estimate(0.42, 0.0)


def static_test_of(columns, second_moment=None):
    """What `twin identify` says of a static test on a link of the paper's length."""
    rig = preset("bossi2009")
    table = campaign.StaticTest(columns, second_moment)
    return static_test.evaluate(campaign.Campaign("paper", rig, {}, (), table))


@pytest.fixture
def table_one():
    return static_test_of({"tip_load_mass": MASSES, "tip_deflection": DISPLACEMENTS}, second_moment=2.95e-11)


def test_table_one_reads_as_in_the_paper_and_says_what_does_not_add_up(table_one):
    said = findings.static(table_one, Estimate(0.24957, 0.005)).sentences
    assert any(s.startswith("Row 1 lies −1 mm off the line through the others") for s in said)
    [without] = [s for s in said if s.startswith("Without it")]
    # Rows 2 to 5 are a line to the last digit, 0.2423 N m^2 with g = 9.81 m/s^2; its tare is the plate's 0.019 kg.
    assert "EI = 0.2422 " in without
    assert "E = 8.21" in without
    assert "tare = 0.186 N (0.019 kg)" in without
    assert "With that tare row 1 by itself gives EI = 0.2527 N·m²." in said
    assert "last decimals, 0.0098 N and 1 mm" in said[0]


def test_table_one_in_numbers(table_one):
    odd = table_one.outlier
    assert odd.row == 0
    assert odd.residual == pytest.approx(-0.001, abs=1e-9)
    assert odd.without.stiffness.value == pytest.approx(0.2423, abs=2e-4)
    assert odd.without.tare / g == pytest.approx(0.019, abs=1e-6)
    assert odd.own_stiffness == pytest.approx(0.2527, abs=2e-4)
    assert table_one.modulus.value == pytest.approx(table_one.stiffness.value / 2.95e-11)


@pytest.mark.slow
def test_loads_read_to_few_decimals_do_not_flatten_the_line():
    rng = np.random.default_rng(5)
    force, off = np.linspace(0.0, 0.3, 400), {"both": [], "plain": []}
    compliance = 0.42**3 / (3 * 0.25)
    for _ in range(20):
        read, y = np.round(force + rng.normal(0, 0.05, 400), 2), np.round(compliance * force, 5)
        found = static_test_of({"tip_force": read, "tip_deflection": y})
        off["both"].append(found.stiffness.value / 0.25 - 1)
        plain = static_line.stiffness(static_line.fit_line(read, y), LENGTH)
        off["plain"].append(plain.value / 0.25 - 1)
    # The variance of the forces is 0.0075 N^2, of their errors 0.0025 N^2.
    assert np.mean(off["plain"]) > 0.25
    assert abs(np.mean(off["both"])) < 0.02


def test_the_second_moment_of_the_section_is_read_from_the_campaign(tmp_path):
    folder = campaign_folder.write(tmp_path)
    (folder / "static.csv").write_text("tip_force,tip_deflection\n0.1,0.01\n0.2,0.02\n0.3,0.03\n")
    with (folder / "campaign.toml").open("a") as file:
        file.write("\n[static]\nsecond_moment = 2.95e-11\n")
    read = read_campaign(folder)
    assert read.static.second_moment == 2.95e-11
    said = static_test.evaluate(read)
    assert said.modulus.value == pytest.approx(said.stiffness.value / 2.95e-11)


def test_errors_in_both_variables_do_not_flatten_a_line():
    rng = np.random.default_rng(3)
    true = np.linspace(0, 1, 400)
    off = {"plain": [], "both": []}
    for _ in range(40):
        x, y = true + rng.normal(0, 0.1, 400), 0.5 + 2 * true + rng.normal(0, 0.2, 400)
        off["plain"].append(static_line.fit_line(x, y).slope.value - 2)
        both = static_line.fit_line(x, y, ratio=0.5)
        off["both"].append(both.slope.value - 2)
    # The variance of x is 1/12 and its noise 0.01: a plain line is flatter by 11 %.
    assert np.mean(off["plain"]) == pytest.approx(-0.21, abs=0.03)
    assert abs(np.mean(off["both"])) < 3 * both.slope.standard_error / math.sqrt(40)
    assert both.slope.standard_error == pytest.approx(np.std(off["both"]), rel=0.35)


@pytest.mark.parametrize(("rows", "decimals"), [(4, 3), (4, 5), (6, 5)])
def test_interval_of_few_rows_holds_the_truth(rows, decimals):
    rng = np.random.default_rng(8)
    force, held = np.linspace(0.2, 2.0, rows), 0
    for _ in range(400):
        y = 0.002 + 0.42**3 / (3 * 0.25) * force + rng.normal(0, 3e-4, rows)
        line = static_line.fit_line(force, np.round(y, decimals), steps=(0.0, 10.0**-decimals))
        low, high = static_line.stiffness(line, Estimate(0.42, 0.0)).interval
        held += low <= 0.25 <= high
    assert held / 400 > 0.93


def test_a_bent_load_line_is_seen():
    x = np.linspace(0, 1, 12)
    noise = np.random.default_rng(0).normal(0, 0.003, 12)
    assert static_line.fit_line(x, x + noise).is_straight
    assert not static_line.fit_line(x, x - 0.1 * x**2 + noise).is_straight


def test_displacement_against_its_load_is_an_error():
    line = static_line.fit_line(np.arange(4.0), -np.arange(4.0))
    with pytest.raises(InputError, match=r"static\.csv.*direction of the load"):
        static_line.stiffness(line, LENGTH)


def envelope(losses: tuple[float, float, float], time: np.ndarray, first: float) -> np.ndarray:
    """Amplitude (n) with a_t = -(c0 + c1 a + c2 a^2), by small steps."""
    a = np.empty_like(time)
    a[0] = first
    for k, h in enumerate(np.diff(time)):
        middle = a[k] - h / 2 * float(np.polyval(losses[::-1], a[k]))
        a[k + 1] = max(a[k] - h * float(np.polyval(losses[::-1], middle)), 0.0)
    return a


def ringing(
    losses: tuple[float, float, float] = (0.0, 0.05, 0.0),
    span: float = 12.0,
    noise: float = 2e-6,
    seed: int = 0,
) -> Recording:
    """A clamped link that rings at 1.243 Hz from 300 microstrain."""
    time = np.arange(0, span, 0.002)
    strain = envelope(losses, time, 3e-4) * np.cos(2 * np.pi * 1.243 * time)
    strain = strain + noise * np.random.default_rng(seed).standard_normal(len(time))
    channels = {"torque_command": np.zeros(len(time)), "strain_base": strain}
    return Recording("ring.csv", time, channels, clamped=True)


def read(recording: Recording) -> decay.Decay | None:
    return decay.fit_ring_down(recording, "strain_base", recording.time[0], recording.time[-1])


@pytest.mark.parametrize(
    ("losses", "law"),
    [
        ((0.0, 0.06, 0.0), "proportional"),
        ((1.5e-5, 0.02, 0.0), "dry friction"),
        ((0.0, 0.02, 600.0), "square of the rate"),
    ],
)
def test_the_envelope_tells_where_the_energy_goes(losses, law):
    found = read(ringing(losses))
    assert found.law == law
    assert found.losses == pytest.approx(losses, rel=0.15, abs=1e-9)


def test_decrement_and_fit_agree_and_hold_the_truth():
    found = read(ringing())
    truth = 0.05 / (2 * math.pi * 1.243)
    for said in (found.by_decrement, found.by_fit, found.damping_ratio):
        assert abs(said.value - truth) < 3 * said.standard_error < 0.1 * truth
    assert abs(found.frequency.value - 1.243) < 3 * found.frequency.standard_error


def test_intervals_of_short_and_noisy_decays_hold_the_truth():
    # Four and a half periods, noise of a tenth of the amplitude.
    found = [read(ringing(span=3.7, noise=3e-5, seed=seed)) for seed in range(20)]
    assert all(d is not None for d in found)
    off = [normalised_difference(d.frequency, Estimate(1.243, 0.0)) for d in found]
    assert np.mean(np.array(off) < 1.96) >= 0.85
    off = [normalised_difference(d.by_fit, Estimate(0.05 / (2 * math.pi * 1.243), 0.0)) for d in found]
    assert np.mean(np.array(off) < 1.96) >= 0.85


def test_too_short_or_silent_records_give_no_decay():
    assert read(ringing(span=2.0)) is None
    assert read(ringing(losses=(0.0, 50.0, 0.0), noise=1e-5)) is None


def test_pooled_estimates_that_contradict_each_other_say_so():
    alike = pooled([Estimate(1.0, 0.1), Estimate(1.05, 0.1)])
    assert alike.standard_error == pytest.approx(0.1 / math.sqrt(2))
    assert pooled([Estimate(1.0, 0.1), Estimate(2.0, 0.1)]).standard_error == pytest.approx(0.5)


def resonance(
    frequency: float, ratio: float, amplitude: float = 0.05, noise: float = 0.0, seed: int = 0
) -> Recording:
    """A torque sweep over 3 to 12 Hz, and a strain that is one mode's answer to it."""
    time = np.arange(0, 20, 0.002)
    age = np.clip(time - 0.5, 0, 18)
    torque = amplitude * np.sin(2 * np.pi * (3 * age + 4.5 * age**2 / 18)) * ((time > 0.5) & (time < 18.5))
    omega = 2 * np.pi * frequency
    mode = dlsim_of(omega, ratio, torque)
    strain = 1e-2 * mode + noise * np.random.default_rng(seed).standard_normal(len(time))
    return Recording(f"{amplitude}.csv", time, {"torque_command": torque, "strain_base": strain})


def dlsim_of(omega: float, ratio: float, torque: np.ndarray) -> np.ndarray:
    """Answer (n) of omega^2/(s^2 + 2 zeta omega s + omega^2) to a torque that is held for 2 ms."""
    b, a, _ = cont2discrete(([omega**2], [1, 2 * ratio * omega, omega**2]), 0.002, "zoh")
    return lfilter(b.ravel(), a, torque)


def test_peak_of_a_planted_mode():
    found = spectra.frequency_response([resonance(7.27, 0.034, noise=1e-6)])
    [peak] = spectra.peaks(found)
    assert abs(peak.frequency.value - 7.27) < 2 * peak.frequency.standard_error + 0.01
    assert peak.damping_ratio.value == pytest.approx(0.034, rel=0.1)
    near = np.abs(found.frequency - 7.27) < 1
    assert (found.coherence[near] > 0.9).all()


def test_without_noise_the_estimators_are_one_and_with_noise_h1_is_below_h2():
    clean, noisy = (spectra.frequency_response([resonance(7.27, 0.034, noise=n)]) for n in (1e-9, 3e-5))
    # Off the peak, where the average over a band does not count.
    near = np.abs(clean.frequency - 5) < 1
    assert np.abs(clean.h2[near] / clean.h1[near] - 1).max() < 0.02
    off = np.abs(noisy.frequency - 11) < 0.5
    assert np.mean(np.abs(noisy.h1[off])) < np.mean(np.abs(noisy.hv[off])) < np.mean(np.abs(noisy.h2[off]))


def fed_back(seed: int = 0) -> Recording:
    """A closed loop about one mode at 7.27 Hz: u = r - 80 (strain + noise), r a sweep over 3 to 12 Hz."""
    swept = resonance(7.27, 0.2)
    reference = swept["torque_command"]
    omega = 2 * np.pi * 7.27
    b, a, _ = cont2discrete(([omega**2], [1, 0.4 * omega, omega**2]), 0.002, "zoh")
    (_, b1, b2), (_, a1, a2) = 1e-2 * b.ravel(), a
    noise = 1e-3 * np.random.default_rng(seed).standard_normal(len(reference))
    y, u = np.zeros(len(reference)), np.zeros(len(reference))
    for k in range(len(reference)):
        if k > 1:
            y[k] = b1 * u[k - 1] + b2 * u[k - 2] - a1 * y[k - 1] - a2 * y[k - 2]
        u[k] = reference[k] - 80 * (y[k] + noise[k])
    channels = {"torque_command": u, "hub_reference": reference, "strain_base": y + noise}
    return Recording("loop.csv", swept.time, channels, loop="closed")


def test_of_a_closed_loop_the_response_is_by_the_reference_and_h1_is_biased():
    loops = [fed_back(seed) for seed in range(6)]
    by_reference, by_torque = (
        spectra.frequency_response(recordings)
        for recordings in (loops, [r.replace(loop="open") for r in loops])
    )
    f = by_reference.frequency
    s, omega = 2j * np.pi * f, 2 * np.pi * 7.27
    true = 1e-2 * omega**2 / (s**2 + 0.4 * omega * s + omega**2)
    near = np.abs(f - 7.5) < 3
    off = [np.abs(np.mean((found.h1 / true)[near] - 1)) for found in (by_reference, by_torque)]
    assert off[0] < 0.03
    assert off[1] > 0.1
    assert (by_reference.estimator, by_torque.estimator) == ("by the reference", "H1")
    said = findings.spectra(by_reference, (), None, Estimate(7.27, 0.01)).sentences
    assert any("by the reference as instrument" in s for s in said)
    assert not any(
        "instrument" in s for s in findings.spectra(by_torque, (), None, Estimate(7.27, 0.01)).sentences
    )
    curves = [trace.name for trace in pictures.response(by_reference).data]
    assert "by the reference" in curves
    assert "H1" not in curves


def test_a_step_is_no_sweep():
    recording = resonance(7.27, 0.034)
    torque = np.where(recording.time > 1, 0.05, 0.0)
    assert (
        spectra.frequency_response(
            [recording.replace(channels={**recording.channels, "torque_command": torque})]
        )
        is None
    )


def test_backbone_of_a_resonance_that_softens_with_amplitude():
    sizes = np.array([0.01, 0.02, 0.03, 0.04])
    softer = [resonance(7.27 * (1 - 0.05 * (a / 0.04) ** 2), 0.02, a, 1e-6, k) for k, a in enumerate(sizes)]
    found = backbone(softer, 7.0)
    assert found.depends_on_amplitude
    assert found.small_amplitude.value == pytest.approx(7.27, abs=0.05)
    assert found.slope.value == pytest.approx(-0.05, abs=0.01)
    still = backbone([resonance(7.27, 0.02, a, 1e-6, k) for k, a in enumerate(sizes)], 7.0)
    assert not still.depends_on_amplitude
    assert backbone(softer[:2], 7.0) is None


RATE = 500  # Hz


def experiments() -> list[Experiment]:
    """A sweep, a decay and a ramp to fit, a slew to predict; 17 s in all."""
    t = np.arange(6 * RATE) / RATE
    age = np.clip(t - 0.3, 0, 5)
    sweep = 0.1 * np.sin(2 * np.pi * (2 * age + 1.9 * age**2)) * ((t > 0.3) & (t < 5.3))
    ramp = 0.03 * np.clip(np.arange(4 * RATE) / RATE - 1, 0, None)
    slew = np.zeros(2 * RATE)
    slew[100:250], slew[250:400] = 0.15, -0.15
    at_rest = np.zeros(5 * RATE)
    return [
        Experiment("sweep", "torque-sweep", "fit", 0.0, sweep),
        Experiment("decay", "free-vibration", "fit", 0.0, at_rest, tip_deflection=0.02),
        Experiment("ramp", "break-away", "fit", 0.0, ramp, ramps=((RATE, 4 * RATE),)),
        Experiment("slew", "slew", "holdout", 0.0, slew),
    ]


def with_a_moving_start(folder, name, cut):
    """Adds a recording without its first 0.4 s as one that was already moving, held out."""
    header, *rows = (folder / name).read_text().splitlines()
    (folder / cut).write_text("\n".join([header, *rows[200:]]) + "\n")
    with (folder / "campaign.toml").open("a") as file:
        file.write(f'\n[[recordings]]\nfile = "{cut}"\nrole = "holdout"\nstart = "unknown"\n')


@pytest.fixture(scope="module")
def run(rig_campaign, tmp_path_factory):
    """A campaign of the virtual rig with a static test, its truth, and the folder that the command wrote."""
    root = tmp_path_factory.mktemp("identify")
    made = rig_campaign({}, 7, name="rig-7", perturb=1.0, experiments=experiments())
    truth = made.truth
    shutil.copytree(made.folder, root / "rig-7")
    force = np.array([0.05, 0.1, 0.15, 0.2, 0.25])
    compliance = truth.true["length"] ** 3 / (3 * truth.true["bending_stiffness"])
    rows = force * compliance + 1e-5 * np.array([1, -1, 0, -1, 1])
    table = "\n".join(f"{f},{y:.6f}" for f, y in zip(force, rows, strict=True))
    (root / "rig-7" / "static.csv").write_text(f"tip_force,tip_deflection\n{table}\n")
    with_a_moving_start(root / "rig-7", "slew.csv", "moving.csv")
    json_file = root / "said.json"
    given = ["--out", str(root / "out"), "--json", str(json_file), "--against", str(root / "rig-7")]
    arguments = ["identify", str(root / "rig-7"), *given]
    result = CliRunner().invoke(cli.app, arguments)
    assert result.exit_code == 0, result.output
    return truth.true, root, json.loads(json_file.read_text()), result.output


@pytest.mark.slow
def test_planted_parameters_are_recovered(run):
    true, _, said, _ = run
    off = {n: (p["value"] - true[n]) / p["standard_error"] for n, p in said["parameters"].items()}
    assert set(off) == set(true) - {"torque_limit"}
    assert max(abs(z) for z in off.values()) < 3.5, off
    # They say at least twice as much as was declared.
    for name in ("bending_stiffness", "hub_inertia", "tip_mass", "static_friction"):
        p = said["parameters"][name]
        assert p["standard_error"] < 0.5 * abs(p["declared"]) * UNCERTAINTY[name], name


@pytest.mark.slow
def test_each_procedure_holds_the_truth_by_itself(run):
    true, _, said, _ = run
    seen = {(n, m) for n, p in said["parameters"].items() for m in p["methods"]}
    expected = {
        *(("bending_stiffness", m) for m in ("static", "clamped-frequency", "joint")),
        *(("damping_ratio", m) for m in ("decay", "joint")),
        *(("hub_inertia", m) for m in ("hub-balance", "joint")),
        *(("coulomb_friction", m) for m in ("hub-balance", "joint")),
        ("static_friction", "break-away"),
    }
    assert expected <= seen
    for name, method in expected:
        e = said["parameters"][name]["methods"][method]
        assert abs(e["value"] - true[name]) < 3.5 * e["standard_error"], (name, method)


@pytest.mark.slow
def test_json_is_what_others_read(run):
    _, _, said, _ = run
    for p in said["parameters"].values():
        assert {"value", "standard_error", "unit", "declared", "methods"} <= set(p)
        assert all(set(e) == {"value", "standard_error", "interval"} for e in p["methods"].values())
        assert all(e["interval"][0] < e["value"] < e["interval"][1] for e in p["methods"].values())
    clamped = [m for m in said["modes"] if m["boundary"] == "clamped"]
    assert clamped[0]["kind"] == "bending"
    assert clamped[0]["frequency_hz"] == pytest.approx(1.24, rel=0.05)
    assert clamped[0]["damping_ratio"] == pytest.approx(0.0057, rel=0.3)
    assert isinstance(said["not_determined"], dict)
    assert said["trusted"], said["reason"]
    assert {"campaign.toml", "slew.csv", "static.csv"} <= set(said["provenance"]["inputs"])
    errors = {e["channel"]: e for e in said["held_out"] if e["recording"] == "slew.csv"}
    assert (
        errors["hub_angle"]["windowed"] < errors["hub_angle"]["following"] < errors["hub_angle"]["declared"]
    )
    assert errors["strain_base"]["by_steps"] < 1.5 * errors["strain_base"]["noise"]


@pytest.mark.slow
def test_json_has_the_procedures_as_numbers_too(run):
    true, _, said, _ = run
    assert said["total_inertia"]["slews"] is None
    total = said["total_inertia"]["joint"]
    inertia = beam.rigid_inertia(preset("bossi2009").replace("true", **true))
    assert abs(total["value"] - inertia) < 3.5 * total["standard_error"]
    assert total["unit"] == "kg*m^2"
    assert said["backbone"] is None
    assert said["friction_map"] is None
    [law] = said["loss_laws"]
    assert (law["recording"], law["law"], len(law["losses"])) == ("decay.csv", "proportional", 3)
    [level] = said["levels"]["static_friction"].values()
    assert abs(level["value"] - true["static_friction"]) < 3.5 * level["standard_error"]
    for level in said["levels"]["coulomb_friction"].values():
        assert abs(level["value"] - true["coulomb_friction"]) < 3.5 * level["standard_error"]
    names, matrix = said["correlations"]["parameters"], np.array(said["correlations"]["matrix"])
    assert matrix.shape == (len(names), len(names))
    assert np.diag(matrix) == pytest.approx(1.0)
    assert all(abs(pair["correlation"]) > 0.9 for pair in said["correlations"]["tied"])


def test_what_is_no_number_in_one_campaign_is_in_another():
    ends = Estimate(7.0, 0.1)
    moved = Backbone(("a", "b", "c"), "strain_base", np.arange(3.0), (ends,) * 3, ends, Estimate(-0.2, 0.01))
    said = as_json.backbone(moved)
    assert said["moves"]
    assert said["simulated_slope"] is None
    assert said["frequency_hz"] == [7.0] * 3
    mapped = friction_map.FrictionMap(
        "r.csv", np.arange(2.0), np.arange(2.0), Estimate(0.5, 0.1), Estimate(5e-3, 1e-4), 0.03
    )
    assert as_json.friction_map(mapped)["level"]["interval"] == pytest.approx([4.804e-3, 5.196e-3])


@pytest.mark.slow
def test_a_held_out_recording_that_was_already_moving_has_errors_too(run):
    _, _, said, output = run
    errors = {e["channel"]: e for e in said["held_out"] if e["recording"] == "moving.csv"}
    assert all(e["start"] == "estimated" for e in errors.values())
    assert errors["hub_angle"]["windowed"] < 2 * errors["hub_angle"]["noise"]
    assert errors["strain_base"]["by_steps"] < 1.5 * errors["strain_base"]["noise"]
    assert {e["start"] for e in said["held_out"] if e["recording"] == "slew.csv"} == {"rest"}
    table = output[output.index("Held-out recordings") :]
    assert "moving.csv" in table
    assert "slew.csv" in table


@pytest.mark.slow
def test_intervals_are_told_with_where_they_come_from(run):
    _, _, said, output = run
    for name, p in said["parameters"].items():
        low, high = p["interval"]
        assert low < p["value"] < high, name
        if p["interval_by"] == "covariance":
            assert (high - low) / 2 == pytest.approx(1.96 * p["standard_error"], rel=1e-3)
        else:
            assert f"not quadratic in {name}" in output
    # One sweep has no slews.
    assert "The total inertia, and the payload by it, are missing" in output
    assert "moves the estimate by more than chance" in output or "standard errors of the move" in output


@pytest.mark.study
def test_an_effect_that_a_rig_is_known_to_have_is_identified_with_it(rig_campaign, tmp_path):
    planted = {"viscous-friction": {"viscous": 0.02}}
    made = rig_campaign(planted, 8, perturb=1.0, experiments=experiments())
    truth, declared = made.truth.true, made.read().rig
    lines = [
        *header_lines("rig-8", "as declared"),
        *(li for p in declared.parameters.values() for li in parameter_lines(p)),
    ]
    lines += effect_lines("viscous-friction", {"viscous": 0.015}, {"viscous": 0.01}, {}, "roughly known")
    (tmp_path / "rig.toml").write_text("\n".join(lines))
    given = ["--rig", str(tmp_path / "rig.toml"), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(cli.app, ["identify", str(made.folder), *given])
    assert result.exit_code == 0, result.output
    said = json.loads((tmp_path / "out" / "identification.json").read_text())
    law = said["effects"]["viscous-friction.viscous"]
    assert abs(law["value"] - 0.02) < 3.5 * law["standard_error"] < 3.5e-3
    assert (law["declared"], law["unit"]) == (0.015, "N*m*s/rad")
    for name, p in said["parameters"].items():
        methods = {m: e for m, e in p["methods"].items() if m != "joint"}
        assert all(
            abs(e["value"] - truth[name]) < 3.5 * e["standard_error"] for e in (p, *methods.values())
        ), name
    assert {"hub-balance"} <= set(said["parameters"]["coulomb_friction"]["methods"])
    rig, effects = read_rig_file(tmp_path / "out" / FOLDER.files["rig"])
    assert effects == {"viscous-friction": {"viscous": pytest.approx(law["value"])}}
    assert rig["hub_inertia"] == pytest.approx(said["parameters"]["hub_inertia"]["value"])


@pytest.mark.parametrize(("peak", "said"), [(6.5, True), (7.26, False), (18.4, False)])
def test_a_peak_that_friction_has_moved_is_said_to_be(peak, said):
    mode = Mode("free", Estimate(peak, 0.02), None, "bending", "s.csv, strain_base")
    found = findings.spectra(
        spectra.frequency_response([fed_back(0)]), (mode,), None, Estimate(7.27, 0.01)
    ).sentences
    assert any("small vibration" in sentence for sentence in found) == said


@pytest.mark.slow
def test_beside_itself_a_campaign_has_its_own_peaks(run):
    _, _, said, output = run
    assert said["against"]["campaign"] == "rig-7"
    assert not said["against"]["changed"]
    assert not said["against"]["appeared"]
    for peak in said["against"]["peaks"]:
        assert peak["other_hz"] == pytest.approx(peak["frequency_hz"])
        assert peak["kind"] == "bending"
    assert "Peaks beside those of rig-7" in output


@pytest.mark.slow
def test_the_identified_rig_is_read_by_every_command(run, twin):
    _, root, said, _ = run
    file = root / "out" / "identified-rig.toml"
    rig, _ = read_rig_file(file)
    for name, p in said["parameters"].items():
        assert rig[name] == pytest.approx(p["value"], rel=1e-12)
        assert rig.parameters[name].uncertainty == pytest.approx(p["standard_error"] / p["value"], rel=1e-9)
    code, _, error = twin("run", "bang-bang-20", "--plant", "modal", "--rig", file)
    assert code == 0, error


@pytest.mark.slow
def test_the_page_shows_what_was_found(run, tmp_path):
    _, root, _, output = run
    page = (root / "out" / "identification.html").read_text(encoding="utf-8")
    for title in ("Stiffness from a static test", "Damping from free vibration", "Joint estimate"):
        assert title in page
        assert title in output
    assert page.count('class="plot"') >= 6
    if browser.CHROMIUM:
        browser.assert_readable({"identification": page}, tmp_path, figures=6)


@pytest.mark.slow
def test_a_folder_of_something_else_is_not_written_into(run, twin, tmp_path):
    _, root, _, _ = run
    (tmp_path / "mine.txt").write_text("keep")
    code, _, error = twin("identify", root / "rig-7", "--out", tmp_path)
    assert code == 2
    assert "holds mine.txt, which no identification wrote" in error
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.slow
def test_its_own_folder_is_known_again(run):
    _, root, _, _ = run
    assert FOLDER.choose(root / "out", root / "rig-7") == root / "out"


def test_bad_input_is_one_message_and_writes_nothing(twin, tmp_path):
    code, _, error = twin("identify", "no-such-folder")
    assert code == 2
    assert "no-such-folder" in error
    assert twin("identify")[0] == 2
    assert not list(tmp_path.iterdir())


def test_what_recordings_do_not_allow_is_said_in_a_sentence():
    nothing = StaticFriction((), (), {}, None, math.nan)
    found = [
        findings.static(None, Estimate(0.25, 0.005)),
        findings.decays(()),
        findings.break_aways(nothing),
        findings.inertia(None, None, Estimate(0.03, 0.001), None, None),
        findings.spectra(None, (), None, Estimate(7.27, 0.01)),
    ]
    assert all(f.missing and not f.sentences for f in found)


SENSORS = {
    "strain_base": Sensor("strain_base", 2e-6, 0.02, 0.0008),
    "hub_angle": Sensor("hub_angle", 3e-4),
}


def recorded(model: Model, experiment: Recording, seed: int) -> Prepared:
    """What the sensors read where a model runs an experiment, ready to be fitted."""
    seen = simulate(model, experiment, Start())
    rng = np.random.default_rng(seed)
    noisy = {c: seen[c] + s.noise * rng.standard_normal(len(seen.time)) for c, s in SENSORS.items()}
    recording = experiment.replace(channels={"torque_command": experiment["torque_command"], **noisy})
    return prepare(recording, {c: s.noise for c, s in SENSORS.items()})[0]


@pytest.mark.slow
@pytest.mark.parametrize(("coulomb", "static", "seed"), [(0.0055, 0.02, 0), (0.004, 0.015, 1)])
def test_coulomb_friction_from_the_decay_of_an_unclamped_link(rig_campaign, coulomb, static, seed):
    rig = Rig(
        static_positive=static, static_negative=static, coulomb_positive=coulomb, coulomb_negative=coulomb
    )
    plan = free_release(rig, Sensors(), np.random.default_rng(seed))
    plan = replace(plan, commands=plan.commands[:1500])
    given = rig_campaign({}, seed, rig=rig, experiments=[plan]).read()
    prepared, _ = prepare(given.fit[0], noise_levels(given))
    believed = given.rig.replace("believed", coulomb_friction=0.85 * coulomb)
    model = Model(believed, given.sensors, chain.fit_shape(believed, 12), step=2.5e-4)
    found = friction_map.friction_map_of_release(model, [prepared], [prepared.start])
    assert (np.diff(found.damping) > 0).all()
    # Without friction there is the declared damping of the free modes.
    assert found.damping[0] == pytest.approx(0.034, rel=0.1)
    assert abs(found.level.value - coulomb) < 2.5 * found.level.standard_error < 0.02 * coulomb


def test_noise_of_a_swing_is_shared_with_the_next():
    frequency, period, noise, count = 7.27, 0.002, 2e-6, 5
    rng = np.random.default_rng(0)
    sections = friction_map._low_pass(frequency, period)
    smooth = sosfiltfilt(sections, noise * rng.standard_normal((4000, 800)), axis=-1)
    tops = smooth[:, 200 + np.round(np.arange(count + 1) * 0.5 / frequency / period).astype(int)]
    swings = (-1.0) ** np.arange(count) * (tops[:, :-1] - tops[:, 1:])
    found = friction_map._swing_covariance(count, period, frequency, noise)
    # Of 4000 draws each entry scatters by some 2 % of the variance.
    assert found == pytest.approx(np.cov(swings.T), abs=0.08 * found[0, 0])
    assert found[0, 1] > 0.3 * found[0, 0]


def test_what_the_damping_leaves_open_is_in_the_error_of_the_decay_map():
    def mapped(level):
        none = np.zeros(0)
        return friction_map.FrictionMap("free.csv", none, none, Estimate(0.05, 1e-3), level, 0.03)

    found = friction_map.with_map_nuisance_error(
        mapped(Estimate(5e-3, 3e-5)), mapped(Estimate(4.96e-3, 3e-5))
    )
    assert found.level.value == 5e-3
    assert found.level.standard_error == pytest.approx(5e-5)
    assert friction_map.with_map_nuisance_error(mapped(None), None).level is None
    assert friction_map.with_map_nuisance_error(mapped(None), mapped(Estimate(5e-3, 3e-5))).level is None


def test_break_away_on_a_staircase_lies_between_two_stairs():
    true = preset("bossi2009").replace("even", static_friction=0.042, coulomb_friction=0.03)
    model = Model(true, SENSORS, chain.fit_shape(true, 5), step=1e-3)
    time = np.arange(0, 5.5, 0.004)
    stairs = -0.01 * np.floor(time)
    still = np.zeros(len(time))
    climb = Recording(
        "stairs.csv", time, {"torque_command": stairs, "hub_angle": still, "strain_base": still}
    )
    prepared = recorded(model, climb, seed=1)
    found = break_away.static_friction(DrivenData.of([prepared], model), model, [prepared.start])
    assert set(found.by_direction) == {-1}
    assert found.level.value == pytest.approx(0.045)
    assert found.level.standard_error == pytest.approx(0.01 / math.sqrt(12))
