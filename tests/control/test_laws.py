"""Controllers: the paper's, those beyond it, and those from the user's files."""

import math
import textwrap

import control
import numpy as np
import pytest
from paths import ROOT

from twin.control import plants
from twin.control.closed_loop import run
from twin.control.laws.library import CONTROLLERS, controller
from twin.control.laws.lqi import OBSERVER_POLES, design, lqi
from twin.control.laws.shaper import ShapedReference, extra_insensitive, residual_vibration, zero_vibration
from twin.control.laws.siso import siso
from twin.errors import InputError
from twin.rigs import preset

RIG = preset("bossi2009")
WITHOUT_FRICTION = RIG.replace(static_friction=0.0, coulomb_friction=0.0)
PERIOD = 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_controller_moves_every_plant_to_the_reference(name):
    """The same object, called and reset by the same loop; a slow ramp to 40 degrees is within the reach of all."""
    law = controller(name, RIG, PERIOD)
    torques = []
    for kind in ("chain", "modal", "compiled", "paper", "chain"):
        result = run(plants.make_plant(kind), law, lambda time: math.radians(40) * min(time / 2, 1), 6.0)
        assert np.degrees(result.true["hub_angle"][-1]) == pytest.approx(40, abs=4), kind
        assert np.abs(result.true["motor_torque"]).max() <= RIG["torque_limit"] + 1e-12
        torques.append(result.torque_command)
    # Nothing of the runs between is left in it.
    np.testing.assert_array_equal(torques[-1], torques[0])


def test_siso_has_the_frequency_response_of_the_paper():
    law = siso(RIG, PERIOD)
    omega, u = 2 * math.pi * 2.0, []
    for k in range(5000):
        u.append(law.torque({"hub_angle": -math.radians(math.sin(omega * k * PERIOD))}, 0.0))
    s = 1j * omega
    steady = np.array(u[2500:])
    wave = np.exp(1j * omega * PERIOD * np.arange(2500, 5000))
    measured = 2 * np.mean(steady * np.conj(wave)) * 1j
    assert measured == pytest.approx(5 * (s + 1) / ((s + 5) * (s + 300)), rel=2e-3)


def test_lq_gains_solve_the_riccati_equation_and_the_observer_has_its_poles():
    A, B, C, K, L = design(RIG)
    assert sorted(np.linalg.eigvals(A - L @ C).real) == pytest.approx(sorted(OBSERVER_POLES), abs=1e-5)
    whole = np.zeros((5, 5))
    whole[:4, :4], whole[4, :4] = A, C[0]
    closed = whole - np.vstack([B, [[0.0]]]) @ K[None]
    assert np.linalg.eigvals(closed).real.max() < 0


def test_lq_integrator_stands_still_while_the_amplifier_saturates():
    law = lqi(RIG, PERIOD)
    for _ in range(100):
        u = law.torque({"hub_angle": 0.0, "tip_deflection": 0.0}, math.radians(120))
    assert u == RIG["torque_limit"]
    assert law.states["integral"] == 0.0
    law.reset()
    for _ in range(100):
        law.torque({"hub_angle": 0.0, "tip_deflection": 0.0}, 1e-3)
    assert law.states["integral"] == pytest.approx(-1e-3 * 100 * PERIOD)


@pytest.mark.parametrize("ratio", [0.0, 0.05])
def test_zero_vibration_shaper_cancels_its_mode(ratio):
    assert residual_vibration(*zero_vibration(1.24, ratio), 1.24, ratio) < 1e-12
    assert residual_vibration(*zero_vibration(1.24, ratio), 1.24 * 1.1, ratio) > 0.1


def test_extra_insensitive_shaper_bears_a_wrong_frequency():
    shaper = extra_insensitive(1.24, 0.0)
    assert residual_vibration(*shaper, 1.24, 0.0) == pytest.approx(0.05)
    worst = max(residual_vibration(*shaper, 1.24 * f, 0.0) for f in np.linspace(0.81, 1.19, 39))
    assert worst <= 0.0501


def test_shaped_reference_keeps_its_sum_and_its_mean_delay():
    class Echo:
        def reset(self):
            pass

        def torque(self, measured, reference):
            return reference

    instants, amplitudes = zero_vibration(1.2345, 0.01)
    shaped = ShapedReference(Echo(), instants, amplitudes, PERIOD)
    response = np.array([shaped.torque({"hub_angle": 0.0}, 1.0 if k else 0.0) for k in range(400)])
    impulses = np.diff(response)
    assert impulses.sum() == pytest.approx(1.0)
    assert impulses @ np.arange(399) * PERIOD == pytest.approx(instants @ amplitudes)


@pytest.mark.parametrize(
    ("rig", "step", "share"), [(WITHOUT_FRICTION, 0.5, 0.3), (RIG, 1.0, 0.2), (RIG, 2.0, 0.6)]
)
def test_shaped_step_leaves_less_vibration(rig, step, share):
    left = {}
    for name in ("lqi", "lqi-ei"):
        result = run(
            plants.make_plant("compiled", rig), controller(name, rig, PERIOD), lambda time: step, 3.0
        )
        left[name] = np.ptp(result.true["tip_deflection"][-500:])
    assert left["lqi-ei"] < share * left["lqi"]


def test_a_jump_of_the_reference_is_no_motion_to_the_observer():
    laws = controller("lqi", RIG, PERIOD), controller("lqi", RIG, PERIOD)
    at_rest = {"hub_angle": 0.0, "tip_deflection": 0.0}
    laws[0].torque(at_rest, 1.0)
    laws[1].torque(at_rest, 0.0)
    laws[1].torque(at_rest, 1.0)
    assert laws[1].states["alpha_t"] == pytest.approx(laws[0].states["alpha_t"])


# The user's files


def user_file(tmp_path, text, name="make"):
    path = tmp_path / "mine.py"
    path.write_text(textwrap.dedent(text))
    return f"{path}:{name}"


@pytest.mark.parametrize(
    "text",
    [
        "def make(measured, reference):\n    return 0.05 * (reference - measured['hub_angle'])",
        "def make(rig, period):\n    return lambda y, r: 0.05 * (r - y['hub_angle'])",
        "class make:\n    def torque(self, y, r):\n        return 0.05 * (r - y['hub_angle'])",
        "class make:\n    def __init__(self, rig):\n        self.k = 0.05\n"
        "    def reset(self):\n        self.n = 0\n"
        "    def torque(self, y, r):\n        self.n += 1\n        return self.k * (r - y['hub_angle'])",
        "import control\nmake = control.ss([], [], [], [[0.05]])",
        "import control\ndef make(period):\n    return control.ss([], [], [], [[0.05]], period)",
    ],
)
def test_what_a_user_plugs_in_acts_as_what_it_is(tmp_path, text):
    law = controller(user_file(tmp_path, text), RIG, PERIOD)
    law.reset()
    assert law.torque({"hub_angle": 0.2, "time": 0.0}, 1.0) == pytest.approx(0.04)


def test_continuous_system_is_sampled_by_tustin(tmp_path):
    text = "import control\nmake = control.tf([1], [0.1, 1])"
    law = controller(user_file(tmp_path, text), RIG, PERIOD)
    reference = control.sample_system(control.ss(control.tf([1], [0.1, 1])), PERIOD, "bilinear")
    steps = [law.torque({"hub_angle": 0.0}, 1.0) for _ in range(50)]
    assert steps == pytest.approx(control.step_response(reference, 49 * PERIOD).outputs)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def mke(rig): pass", "has no 'make'; it has: mke; did you mean 'mke'"),
        ("make = 3", "'make' is int; expected"),
        ("def make(rig):\n    raise ValueError('no gain')", r"mine.py: line 2: ValueError: no gain"),
        ("def make(a, b, c): pass", r"takes no \(measured, reference\)"),
        ("def make(:", "line 1"),
        ("import control\nmake = control.ss([], [], [], [[1, 2]])", "2 inputs and 1 outputs"),
        ("import control\nmake = control.ss([], [], [], [[1]], 0.01)", "period of 0.01 s; expected 0.002 s"),
    ],
)
def test_what_cannot_be_used_is_said(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        controller(user_file(tmp_path, text), RIG, PERIOD)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("return 'much'", "returned 'much'"),
        ("return float('nan')", "nan"),
        ("return 1 / 0", "line 2: ZeroDivision"),
    ],
)
def test_what_goes_wrong_in_a_run_is_said(tmp_path, line, message):
    law = controller(user_file(tmp_path, f"def make(measured, reference):\n    {line}"), RIG, PERIOD)
    with pytest.raises(InputError, match=message):
        law.torque({"hub_angle": 0.0, "time": 0.1}, 1.0)


@pytest.mark.parametrize(
    ("states", "message"),
    [
        ("states = 3", "mine.py: states is 3; expected a dict"),
        ("states = {'a': 'text'}", "mine.py: states is {'a': 'text'}; expected a dict"),
        ("def states(self):\n        return {}", "mine.py: states is <bound method"),
        (
            "@property\n    def states(self):\n        return {'a': 1 / 0}",
            "mine.py: line 6: ZeroDivisionError",
        ),
    ],
)
def test_states_that_are_no_numbers_are_said(tmp_path, states, message):
    text = f"class make:\n    def torque(self, y, r):\n        return 0.0\n    {states}\n"
    with pytest.raises(InputError, match=message):
        run(
            plants.make_plant("modal"),
            controller(user_file(tmp_path, text), RIG, PERIOD),
            lambda time: 0.0,
            0.1,
        )


def test_missing_file_and_unknown_name_are_said():
    with pytest.raises(InputError, match="no such file"):
        controller("nowhere.py:make", RIG, PERIOD)
    with pytest.raises(InputError, match="did you mean 'lqi'"):
        controller("lqj", RIG, PERIOD)
    with pytest.raises(InputError, match=r"expected siso\.py:NAME$"):
        controller("siso.py", RIG, PERIOD)


def test_the_example_of_the_documentation_controls_the_rig(tmp_path):
    text = (ROOT / "docs" / "control.md").read_text(encoding="utf-8")
    example = text.split("```python\n")[1].split("```")[0]
    law = controller(user_file(tmp_path, example, "Mine"), RIG, PERIOD)
    step = run(plants.make_plant("modal"), law, lambda time: math.radians(120), 5.0)
    assert np.degrees(step.true["hub_angle"][-1]) == pytest.approx(120, abs=3)
    assert "rate" in step.states


@pytest.mark.parametrize(
    ("made", "message"),
    [
        ("control.tf([1, 0], [1])", "no more zeros than poles"),
        ("control.frd([1.0], [1.0])", "expected a linear one"),
        ("control.nlsys(None, lambda t, x, u, p: u, inputs=1, outputs=1)", "expected a linear one"),
    ],
)
def test_a_system_that_cannot_be_run_is_refused_in_a_sentence(tmp_path, made, message):
    with pytest.raises(InputError, match=message):
        controller(user_file(tmp_path, f"import control\nmake = {made}"), RIG, PERIOD)
