"""Validation: linear forms are recovered, margins are those of python-control, fleets are judged by their figures."""

import json
import math
import re
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from types import SimpleNamespace

import browser
import control
import numpy as np
import pytest
from marks import slow_except
from rig_campaigns import planned

from twin.control import closed_loop, plants
from twin.control.closed_loop import Run
from twin.control.laws.base import LinearController
from twin.control.laws.library import CONTROLLERS, controller
from twin.control.plants.base import READINGS
from twin.control.plants.sensor_effects import SensorEffects
from twin.control.plants.sensors import Sensors
from twin.correlations import Correlations
from twin.errors import InputError
from twin.mechanics.modal import state_space, zero_order_hold_response
from twin.rigs import preset
from twin.validation import fleet, pictures
from twin.validation.fleet import Evaluator, Job
from twin.validation.linear_form import NoLinearFormError, linear_form_of
from twin.validation.linear_rig import sampled_chain, sampled_modes
from twin.validation.margins import margins
from twin.validation.metrics import performance_metrics
from twin.validation.requirements import DEFAULTS, defaults, read_requirements
from twin.validation.rigs import draw_rigs, uncertain_parameters
from twin.validation.validation import Verdict, drivers

RIG = preset("bossi2009")
T = 2e-3
MODEL = plants.make_model(RIG)
MODEL_RIG = sampled_modes(MODEL, T, 3)


class Law:
    """A law of the hub's error [rad], the deflection [m] and the time [s]."""

    def __init__(self, law):
        self._law = law

    def reset(self):
        pass

    def torque(self, measured, reference):
        return self._law(reference - measured["hub_angle"], measured["tip_deflection"], measured["time"])


class Spillover:
    """Damps the first mode by the rate of the strain at mid-length, where the second mode bends the other way."""

    def reset(self):
        self._before = None

    def torque(self, measured, reference):
        now = np.array([measured["hub_angle"], measured["strain_mid"]])
        rate = (now - (now if self._before is None else self._before)) / T
        self._before = now
        return float(-0.05 * now[0] - 0.02 * rate[0] + 10 * rate[1])


@pytest.fixture(scope="module")
def lqi():
    return linear_form_of(controller("lqi", RIG, T), T)


# Linear form


def test_form_of_a_known_system_has_its_response():
    system = control.sample_system(control.tf([5, 5], [1, 305, 1500]) * 60, T, "bilinear")
    form = linear_form_of(LinearController(control.ss(system), 2.0), T)
    z = np.exp(1j * np.array([0.3, 3.0, 30.0, 300.0]) * T)
    found = [(form.C @ np.linalg.solve(x * np.eye(len(form.A)) - form.A, form.B) + form.D)[0] for x in z]
    # From the hub angle: the error has the other sign.
    np.testing.assert_allclose(np.array(found)[:, 0], -2.0 * system(z), rtol=1e-6)
    assert np.abs(np.array(found)[:, 1:]).max() < 1e-12


@pytest.mark.parametrize("name", slow_except(CONTROLLERS, "lqi"))
def test_every_controller_of_the_library_has_a_linear_form(name):
    form = linear_form_of(controller(name, RIG, T), T)
    assert np.abs(form.B).max() > 0
    # Nothing that grows; the integrator stands still.
    assert np.abs(np.linalg.eigvals(form.A)).max() < 1 + 1e-6


@pytest.mark.parametrize(
    ("law", "reason"),
    [
        (lambda error, tip, time: math.copysign(0.1, error), "-3 times the response|add up"),
        (lambda error, tip, time: 1.0 * error * (1 + time), "depends on time"),
        (lambda error, tip, time: 1e6 * error**3, "-3 times the response"),
        (lambda error, tip, time: 1e6 * error * tip, "add up|does not respond"),
        (lambda error, tip, time: error if abs(error) > 0.01 else 0.0, "does not respond"),
    ],
)
def test_what_is_not_linear_has_no_linear_form(law, reason):
    with pytest.raises(NoLinearFormError, match=reason):
        linear_form_of(Law(law), T)


def test_a_constant_torque_does_not_hide_a_linear_form():
    form = linear_form_of(Law(lambda error, tip, time: 0.01 + 0.3 * error), T)
    np.testing.assert_allclose(form.D, [[-0.3, 0, 0, 0, 0]], atol=1e-6)


# Loop


@pytest.mark.parametrize("delay", [0.0, 1.3e-3, 2e-3, 5.3e-3])
def test_sampled_rig_moves_as_the_continuous_one(delay):
    rig = sampled_modes(plants.make_model(RIG, {"actuator-delay": {"delay": delay}}), T, 3)
    command = np.random.default_rng(0).standard_normal(60)
    x, found = np.zeros(len(rig.A)), []
    for u in command:
        found.append(rig.C @ x)
        x = rig.A @ x + rig.B[:, 0] * u
    fine = np.arange(60 * 20) * 1e-4
    index = np.floor((fine - delay) / T + 1e-6).astype(int)
    late = np.where(index < 0, 0.0, command[index])
    expected = zero_order_hold_response(state_space(RIG), fine, late)[::20]
    np.testing.assert_allclose(np.array(found)[:, :2], expected, atol=1e-9 * np.abs(expected).max())


def test_motor_torque_is_what_acts_before_the_next_command():
    lag = sampled_modes(plants.make_model(RIG, {"actuator-lag": {"time_constant": 0.01}}), T, 3)
    place = READINGS.index("motor_torque")
    np.testing.assert_allclose((lag.C @ lag.B)[place], 1 - math.exp(-T / 0.01))
    assert (MODEL_RIG.C @ MODEL_RIG.B)[place] == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["siso", "lqi"])
def test_margins_are_those_of_python_control(name):
    form = linear_form_of(controller(name, RIG, T), T)
    found = margins(form, MODEL_RIG, T)
    K = control.ss(form.A, form.B, form.C, form.D, T)
    P = control.ss(MODEL_RIG.A, MODEL_RIG.B, MODEL_RIG.C, 0, T)
    omega = np.geomspace(0.05, math.pi / T, 1500, endpoint=False)
    disk, _, _ = control.disk_margins(-K * P, omega)
    gains, phases, *_ = control.stability_margins(control.frd(-K * P, omega), returnall=True)
    assert found.disk == pytest.approx(float(disk), rel=1e-6)
    # Both interpolate between the frequencies.
    assert found.gain == pytest.approx(np.abs(20 * np.log10(gains)).min(), rel=5e-3)
    assert found.phase == pytest.approx(np.abs(phases).min(), rel=5e-3)


def test_a_drive_of_twice_the_gain_takes_6_db(lqi):
    double = sampled_modes(plants.make_model(RIG, {"torque-gain": {"gain": 2.0}}), T, 3)
    lost = margins(lqi, MODEL_RIG, T).gain - margins(lqi, double, T).gain
    assert lost == pytest.approx(20 * math.log10(2), abs=0.02)


def test_a_loop_at_its_gain_margin_is_at_the_edge(lqi):
    margin = margins(lqi, MODEL_RIG, T).gain
    for part, stable in ((0.99, True), (1.01, False)):
        more = sampled_modes(
            plants.make_model(RIG, {"torque-gain": {"gain": 10 ** (part * margin / 20)}}), T, 3
        )
        assert (margins(lqi, more, T).growth < 0) == stable


def test_a_neglected_mode_that_destabilises_is_seen():
    form = linear_form_of(Spillover(), T)
    one, two = (margins(form, sampled_modes(MODEL, T, modes), T) for modes in (1, 2))
    assert one.growth < 0
    assert one.disk > 0
    assert two.growth > 1
    assert two.gain == two.phase == two.disk == 0.0


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"sensor-delay": {"delay": 0.0053, "hub_angle": 1.0, "strain": 1.0, "motor_torque": 0.0}},
        {"cable-torsion": {"stiffness": 0.02, "rest_angle": 0.3}, "hub-sensor-gain": {"gain": 1.2}},
    ],
)
def test_linearised_chain_has_the_margins_of_the_modes(lqi, effects):
    model = plants.make_model(RIG, effects)
    chain, left_out = sampled_chain(model, T)
    one, other = (margins(lqi, rig, T) for rig in (chain, sampled_modes(model, T, 3)))
    assert one.growth == pytest.approx(other.growth, rel=1e-4)
    # 8 segments: the sensor of the deflection sees modes beyond the third.
    assert one.gain == pytest.approx(other.gain, abs=0.05)
    assert one.disk == pytest.approx(other.disk, rel=2e-3)
    assert left_out == ()


def test_a_late_sensor_costs_what_a_late_drive_does(lqi):
    late = {
        "sensor-delay": {"delay": 0.0053, "hub_angle": 1.0, "strain": 1.0, "motor_torque": 0.0},
        "actuator-delay": {"delay": 0.0053},
    }
    one, other = (
        margins(lqi, sampled_chain(plants.make_model(RIG, {name: p}), T)[0], T) for name, p in late.items()
    )
    assert one.phase == pytest.approx(other.phase, abs=0.01)
    assert one.phase < margins(lqi, MODEL_RIG, T).phase - 0.5


def test_a_torsional_mode_is_in_the_linear_loop_and_seen_by_the_strains():
    torsion = {"frequency": 28.0, "damping_ratio": 0.02, "inertia_share": 0.3, "strain_base": 0.5}
    model = plants.make_model(RIG, {"torsional-mode": {**torsion, "strain_mid": 0.0}})
    with_it, without = (sampled_chain(m, T)[0] for m in (model, MODEL))
    assert len(with_it.A) == len(without.A) + 2
    blind = plants.make_model(RIG, {"torsional-mode": {**torsion, "strain_base": 0.0, "strain_mid": 0.0}})
    seen = (with_it.C - sampled_chain(blind, T)[0].C) != 0
    assert set(np.flatnonzero(seen.any(axis=1))) == {READINGS.index("strain_base")}


def test_play_is_left_out_of_the_linear_loop_and_said_so():
    model = plants.make_model(RIG, {"backlash": {"gap": 0.01, "motor_inertia_share": 0.3}})
    rig, left_out = sampled_chain(model, T)
    assert left_out == ("backlash",)
    np.testing.assert_allclose(rig.A, sampled_chain(MODEL, T)[0].A)


# Fleet


def test_a_hub_sensor_with_another_gain_turns_the_hub_too_little():
    [drawn] = draw_rigs(RIG, {"hub-sensor-gain": {"gain": 1.2}}, (), 0, 0)
    outcome = Evaluator(Job("lqi", RIG, "lq-step-120")).outcome(drawn)
    # The reading arrives, the hub stops a sixth before; friction keeps it within 3 % of there.
    assert outcome.metrics["steady_state_error"] == pytest.approx(100 / 6, abs=3)
    assert outcome.metrics["overshoot"] == 0.0


WITHOUT_RESET = """
import gains
class Pid:
    total, before = 0.0, None
    def torque(self, y, r):
        error = r - y["hub_angle"]
        rate = 0.0 if self.before is None else (error - self.before) / 0.002
        self.before = error
        self.total += 0.002 * error
        return gains.K * error + 0.03 * self.total + 0.06 * rate
"""


def test_every_rig_has_a_controller_of_its_own(tmp_path):
    (tmp_path / "pid.py").write_text(WITHOUT_RESET)
    (tmp_path / "gains.py").write_text("K = 0.12")
    [drawn] = draw_rigs(RIG, {}, (), 0, 0)
    bench = Evaluator(Job(f"{tmp_path}/pid.py:Pid", RIG, "lq-step-120"))
    first, second = (bench.outcome(drawn).metrics for _ in range(2))
    assert first == second
    assert bench.no_form == ""  # with an integral left from the pulse before, it would not be linear


@pytest.mark.parametrize(
    "error",
    [BrokenProcessPool("a child process terminated abruptly"), type("KilledWorker", (Exception,), {})()],
)
def test_a_process_that_dies_is_told_in_a_sentence(monkeypatch, error):
    monkeypatch.setattr(fleet, "_evaluate", lambda *_: dying.result())
    dying = Future()
    dying.set_exception(error)
    rigs = draw_rigs(RIG, {}, (), 6, 0)
    with (
        pytest.raises(
            InputError, match="mine.py:law: a process ended while it ran this controller; expected"
        ),
        ThreadPoolExecutor(1) as pool,
    ):
        fleet.run_fleet(Job("mine.py:law", RIG, "lq-step-120"), rigs, print, pool)


def test_a_late_reading_is_what_was_true_then():
    effects = {"sensor-delay": {"delay": 0.006, "hub_angle": 1.0, "strain": 1.0, "motor_torque": 0.0}}
    model = plants.make_model(RIG, effects)
    plant = plants.make_plant("compiled", RIG, effects)
    heard = []
    law = Law(lambda error, tip, time: heard.append(-error) or 0.15)
    sensors = Sensors(effects=SensorEffects(model, plant))
    run = closed_loop.run(plant, law, lambda time: 0.0, 0.3, sensors)
    np.testing.assert_allclose(heard[60:], run.true["hub_angle"][57:-3], atol=1e-9)
    np.testing.assert_allclose(run.measured["hub_angle"], heard, atol=1e-12)
    true = {name: 0.1 for name in READINGS}
    assert SensorEffects(MODEL, plant).read(0.0, true) is true


def test_drawn_rigs_repeat_and_follow_their_uncertainty():
    uncertain = uncertain_parameters(
        RIG, {"viscous-friction": {"viscous": 1e-3}}, {"viscous-friction": {"viscous": 1e-3}}
    )
    few, many = (draw_rigs(RIG, {"viscous-friction": {"viscous": 1e-3}}, uncertain, n, 3) for n in (5, 300))
    assert [dict(r.rig) for r in few] == [dict(r.rig) for r in many[:6]]
    assert dict(many[0].rig) == dict(RIG)
    stiffness = np.array([r.rig["bending_stiffness"] for r in many[1:]]) / RIG["bending_stiffness"]
    # 300 of them: standard errors of mean and deviation are 0.0012 and 4 %.
    assert stiffness.mean() == pytest.approx(1.0, abs=0.005)
    assert stiffness.std() == pytest.approx(0.02, rel=0.17)
    assert {r.rig["torque_limit"] for r in many} == {RIG["torque_limit"]}
    viscous = np.array([r.effects["viscous-friction"]["viscous"] for r in many])
    assert viscous.min() >= 0  # one standard error from its bound
    assert many[7].deviations["viscous-friction.viscous"] == pytest.approx((viscous[7] - 1e-3) / 1e-3)


def test_rigs_are_drawn_about_a_value_beyond_what_a_search_tries():
    effects = {"actuator-lag": {"time_constant": 1.0}}  # a search ends at 0.5 s
    uncertain = uncertain_parameters(RIG, effects, {"actuator-lag": {"time_constant": 0.01}})
    drawn = draw_rigs(RIG, effects, uncertain, 50, 0)[1:]
    values = [rig.effects["actuator-lag"]["time_constant"] for rig in drawn]
    assert abs(np.mean(values) - 1.0) < 0.01
    assert 0.005 < np.std(values) < 0.02


def test_rigs_are_drawn_as_a_fit_correlates_their_parameters():
    together = Correlations(("length", "bending_stiffness"), np.array([[1.0, 0.9], [0.9, 1.0]]))
    rigs = draw_rigs(RIG, {}, uncertain_parameters(RIG, {}), 400, 0, together)[1:]
    away = {n: [r.deviations[n] for r in rigs] for n in ("length", "bending_stiffness", "tip_mass")}
    # 400 of them: the standard error is 0.01 at 0.9 and 0.05 at 0.
    assert np.corrcoef(away["length"], away["bending_stiffness"])[0, 1] == pytest.approx(0.9, abs=0.04)
    assert np.corrcoef(away["length"], away["tip_mass"])[0, 1] == pytest.approx(0.0, abs=0.2)
    assert np.std(away["length"]) == pytest.approx(1.0, abs=0.15)


def response(angle, end=0.5, length=5.0):
    """A run whose hub turns as `angle` (m) of the time, its tip swinging by 3 mm to each side."""
    time = np.arange(0.0, length + T / 2, T)
    zero = np.zeros(len(time))
    true = {"hub_angle": angle(time), "tip_deflection": 3e-3 * np.sin(8 * time), "motor_torque": zero + 0.1}
    torque = np.where(time < 1.0 - T / 2, 0.3, 0.0)
    reference = np.full(len(time), end)
    return Run("made", time, reference, torque, true, true, zero, {}, np.zeros((len(time), 2, 2)), 0.3, 0.1)


def test_figures_are_those_of_an_oscillator():
    zeta, omega = 0.4, 6.0
    damped = omega * math.sqrt(1 - zeta**2)

    def step(t):
        envelope = np.exp(-zeta * omega * t)
        return 0.5 * (1 - envelope * (np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t)))

    found = performance_metrics(response(step), length=0.3)
    assert found["overshoot"] == pytest.approx(100 * math.exp(-math.pi * zeta * omega / damped), rel=1e-3)
    assert found["settling_time"] == pytest.approx(4 / (zeta * omega), rel=0.2)
    assert found["steady_state_error"] < 0.01
    assert found["residual_vibration"] == pytest.approx(2.0, rel=1e-3)
    assert found["peak_deflection"] == pytest.approx(1.0, rel=1e-3)
    assert found["saturated_share"] == pytest.approx(20.0, rel=1e-2)
    assert found["peak_torque"] == 0.1


def test_a_hub_that_stays_outside_its_band_never_settles():
    found = performance_metrics(response(lambda t: 0.5 * 0.97 * (1 - np.exp(-5 * t))), length=0.3)
    assert found["settling_time"] == math.inf
    assert found["overshoot"] == 0.0
    assert found["steady_state_error"] == pytest.approx(3.0, rel=1e-3)


def test_drivers_are_what_a_figure_follows_and_not_what_it_seems_to():
    random = np.random.default_rng(5)
    away = [dict(zip("abcd", random.standard_normal(4), strict=True)) for _ in range(100)]
    # Ranks: neither the bend of the law nor rigs that never settle hide it.
    follows = np.array([math.exp(-3 * x["b"]) + 0.1 * x["a"] if x["b"] > -2 else math.inf for x in away])
    [found] = drivers(follows, away)
    assert found.name == "b"
    assert found.correlation < -0.9
    assert drivers(random.standard_normal(100), away) == ()
    assert drivers(np.full(100, 0.214), away) == ()
    assert drivers(follows[:5], away[:5]) == ()


# Requirements


def test_a_file_changes_some_limits_and_drops_others(tmp_path):
    file = tmp_path / "limits.toml"
    file.write_text("overshoot = 12\nphase_margin = false\nshare = 1\n")
    found = read_requirements(file)
    assert found.limits["overshoot"].limit == 12.0
    assert "phase_margin" not in found.limits
    assert found.share == 1.0
    assert found.limits["settling_time"] == defaults().limits["settling_time"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("overshot = 1", "limits.toml: 'overshot' is not a requirement.*did you mean 'overshoot'"),
        ("overshoot = 'x'", "limits.toml: overshoot is 'x'; expected a number"),
        ("overshoot = nan", "overshoot is nan"),
        ("overshoot = inf", "overshoot is inf; expected a finite number >= 0, or false for no limit"),
        ("settling_time = -1", "settling_time is -1 s; expected a number >= 0 s"),
        ("overshoot = true", "overshoot is true; expected a number, or false for no limit"),
        ("share = 0", "share is 0; expected 1e-06 to 1"),
        ("share = 95", "share is 95"),
        ("overshoot = ", "limits.toml, at its end: Invalid value; expected requirements as TOML"),
        (f"overshoot = {10**400}", "limits.toml: overshoot is beyond the largest number"),
        ("\n".join(f"{r.name} = false" for r in DEFAULTS), "no requirement is left"),
    ],
)
def test_bad_requirements_are_named(tmp_path, text, message):
    file = tmp_path / "limits.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        read_requirements(file)


def test_what_is_not_a_number_meets_nothing():
    assert not any(r.met(math.nan) for r in DEFAULTS)


def test_a_nominal_value_that_is_never_reached_is_no_line():
    settling = next(r for r in DEFAULTS if r.name == "settling_time")
    values = np.array([2.0, 2.2, 2.6, 3.1, np.inf])
    verdict = Verdict(settling, np.inf, values, None, ())
    [limit] = pictures.spreads(SimpleNamespace(verdicts=[verdict]), 4).layout.shapes
    assert (limit.x0, limit.x1) == (3.0, 3.0)


# The command


def test_lqi_passes_and_the_page_needs_no_network(twin, tmp_path):
    code, out, err = twin(
        "validate", "lqi", "--rigs", 4, "--seed", 1, "--json", "v.json", "--report", "v.html"
    )
    assert (code, err) == (0, "")
    assert out.endswith("100 % of rigs keep every limit; 95 % were asked for.\n")
    answer = json.loads((tmp_path / "v.json").read_text())
    assert answer["passed"] is True
    assert answer["kept"] == answer["rigs"] == 4
    assert set(answer["requirements"]) == {r.name for r in DEFAULTS}
    assert answer["requirements"]["overshoot"]["nominal"] == pytest.approx(0.96, abs=0.1)
    page = (tmp_path / "v.html").read_text()
    assert "lqi" in page
    assert "<script src" not in page
    for text in ("100 % of rigs keep every limit; 95 % were asked for.", "Provenance", "drawn rigs: 1"):
        assert text in page
    assert not re.search(
        r"\bfailed\b|[0-9]e-[0-9]| deg\b", page.partition("<footer>")[0].partition("<script")[0]
    )
    assert answer["provenance"]["seeds"] == {"drawn_rigs": 1}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["v.html", "v.json"]
    if browser.CHROMIUM:
        browser.assert_readable({"validation": page}, tmp_path, figures=2)


@pytest.mark.slow
def test_a_users_relay_fails_in_two_processes_and_gets_no_margins(twin, tmp_path):
    (tmp_path / "level.py").write_text("LEVEL = 0.2\n")
    (tmp_path / "relay.py").write_text(
        "from level import LEVEL\n"
        "def relay(measured, reference):\n    return LEVEL if reference > measured['hub_angle'] else -LEVEL\n"
    )
    code, out, _ = twin("validate", "relay.py:relay", "--rigs", 6, "--json", "v.json")
    assert code == 1
    assert "No margins can be given" in out
    answer = json.loads((tmp_path / "v.json").read_text())
    assert answer["margins"] is False
    assert "phase_margin" not in answer["requirements"]
    assert len(answer["failed_rigs"]) == 6


@pytest.mark.slow
def test_rigs_are_drawn_as_a_campaign_declares_them(twin, rig_campaign, tmp_path):
    folder = rig_campaign({}, 7, experiments=planned(7, "break-away")).folder
    _, out, err = twin("validate", "lqi", "--campaign", folder, "--rigs", 2, "--json", "v.json")
    assert err == ""
    assert "lqi on rig" in out
    answer = json.loads((tmp_path / "v.json").read_text())
    assert answer["rigs"] == 2


@pytest.mark.parametrize("rig", ["bossi2009", "bossi2009-printed"])
def test_a_rig_and_a_campaign_are_one_too_many(twin, rig):
    code, _, err = twin("validate", "lqi", "--campaign", "mine", "--rig", rig)
    assert code == 2
    assert "--rig and --campaign both say which rig" in err


@pytest.mark.slow
def test_stricter_requirements_fail(twin, tmp_path):
    limits = {"settling_time": 1, "overshoot": 0.1, "residual_vibration": 0.1, "peak_torque": 0.1}
    (tmp_path / "strict.toml").write_text("".join(f"{name} = {limit}\n" for name, limit in limits.items()))
    code, out, _ = twin("validate", "lqi", "--rigs", 2, "--requirements", "strict.toml")
    assert code == 1
    assert not re.search(r"[a-z]_[a-z]| deg\b|e-0", out)
    assert re.search(r"phase margin +≥ 30°", out)
    # Each figure in its unit; each rig on one line, with all figures in which it is the worst.
    assert re.search(r"peak torque +≤ 0.1 N·m +0.214 N·m +0.214 N·m +0.214 N·m +2", out)
    assert re.search(r"disk margin +≥ 0.4( +0.7\d*){3} +none", out)
    worst = re.findall(r"^worst ([^:]*): rig (\d)", out, re.MULTILINE)
    assert len({rig for _, rig in worst}) == len(worst) <= 2
    figures = ", ".join(text for text, _ in worst)
    for name, unit in (("overshoot", "%"), ("residual vibration", "%"), ("peak torque", "N·m")):
        assert re.search(rf"{name} [\d.]+ {unit}", figures)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("lqy",), "'lqy' is not a controller.*did you mean 'lqi'"),
        (("lqi", "--scenario", "sinus-0.2"), "the reference of sinus-0.2 does not come to rest"),
        (("lqi", "--rig", "none.toml"), "there is no such file"),
        (("lqi", "--rig", "."), "is a folder; expected a TOML file; for a campaign use --campaign"),
        (("lqi", "--json", "none/v.json"), "there is no folder none"),
        (("none.py:law",), "none.py"),
    ],
)
def test_bad_input_is_one_message(twin, tmp_path, arguments, message):
    code, out, err = twin("validate", *arguments)
    assert code == 2
    assert out == ""
    assert err.startswith("Error: ")
    assert err.count("\n") == 1
    assert re.search(message, err)
    assert not list(tmp_path.iterdir())
