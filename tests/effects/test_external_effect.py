"""An effect of another package: found, fitted, written and explained without a line of this package."""

import sys

import mujoco
import numpy as np
import pytest
from rig_campaigns import planned

from twin import effects
from twin.diagnosis.diagnose import diagnose
from twin.effects import Effect, EffectParameter, HubLaw, catalogue
from twin.mechanics.mujoco_chain import MujocoChain
from twin.mechanics.state import Start
from twin.recording import Recording
from twin.report.augmented_rig import to_mjcf
from twin.report.html import render
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.simulate import integrate, simulate
from twin.validation.linear_rig import sampled_chain

CUBIC = 0.1  # N m/rad^3, of the virtual rig's cable that gets stiffer


@HubLaw
def hardening(t, theta, omega, values):
    return -values[0] * theta**3


class HardeningCable(Effect):
    """Torque -cubic theta^3 on the hub: wires that lie slack about zero."""

    name = "hardening-cable"
    meaning = "wires that pull the harder the further the hub turns"
    acts_on = "hub"
    parameters = (EffectParameter("cubic", "N*m/rad^3", 0.0, (0.0, 10.0), 1e-3),)
    hub_law = hardening

    def write_mjcf(self, spec, joint, p):
        spec.joint(joint).stiffness[2] = p["cubic"]


@pytest.fixture(scope="module")
def registered():
    effects.register(HardeningCable())
    yield
    effects.unregister("hardening-cable")


@pytest.fixture(scope="module")
def diagnosed(registered, rig_campaign):
    slews = planned(12, "bang-bang", "random-steps")
    campaign = rig_campaign({"hardening-cable": {"stiffness": CUBIC}}, 12, experiments=slews).read()
    return campaign, diagnose(campaign)


@pytest.mark.study
def test_it_is_diagnosed(diagnosed):
    _, answer = diagnosed
    assert answer.verdict == "explained"
    [effect] = answer.effects
    assert effect.name == "hardening-cable"
    error = effect.standard_errors["cubic"]
    assert effect.parameters["cubic"] == pytest.approx(CUBIC, abs=4 * error + 0.02 * CUBIC)


@pytest.mark.study
def test_the_page_says_what_it_means(diagnosed):
    _, answer = diagnosed
    assert HardeningCable.meaning in render(answer, {})


@pytest.mark.study
def test_the_augmented_mjcf_has_it(diagnosed):
    campaign, answer = diagnosed
    written = to_mjcf(answer, campaign.sensors)
    assert "hardening-cable" not in written.left_out
    model = mujoco.MjModel.from_xml_string(written.xml)
    data = mujoco.MjData(model)
    data.joint("hub").qpos = 0.8
    mujoco.mj_forward(model, data)
    expected = -answer.effects[0].parameters["cubic"] * 0.8**3
    assert data.joint("hub").qfrc_passive[0] == pytest.approx(expected, rel=1e-6)


def test_the_table_of_the_documentation_has_it(registered):
    assert "| `hardening-cable` | wires that pull the harder" in catalogue.markdown()


def test_chain_and_compiled_equations_agree_on_it(registered):
    model = _model()
    time = np.arange(0.0, 0.6, 2e-3)
    recording = Recording("slew", time, {"torque_command": np.where(time < 0.3, 0.15, -0.1)})
    motion = integrate(model, recording, Start(hub_angle=0.5))
    engine = MujocoChain(model.rig, model.chain, model.plant, model.hub_torques)
    phi = np.full(len(model.chain.lengths), 0.5)
    run = (time, recording["torque_command"], time, phi, 0 * phi, 0, False, model.step)
    np.testing.assert_allclose(engine.simulate(*run)[0], motion.angles, atol=3e-5)


def test_it_pulls_the_hub_back(registered):
    time = np.arange(0.0, 1.0, 2e-3)
    channels = {"torque_command": np.full(len(time), 0.1), "hub_angle": np.zeros(len(time))}
    recording = Recording("push", time, channels)
    with_it, without = _model(), _model().replace(effects={})
    far, free = (simulate(m, recording, Start())["hub_angle"].max() for m in (with_it, without))
    assert far < 0.9 * free


def test_a_linear_model_says_that_it_is_left_out(registered):
    assert sampled_chain(_model(), 2e-3)[1] == ("hardening-cable",)


def _model() -> Model:
    from twin.mechanics import chain
    from twin.recording import GAUGES

    rig = preset("bossi2009")
    gauges = {gauge.channel: gauge for gauge in GAUGES}
    effect = {"hardening-cable": {"cubic": CUBIC}}
    return Model(rig, gauges, chain.fit_shape(rig, 5), effect, 5e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "cable-torsion"}, "the name 'cable-torsion' is taken by CableTorsion"),
        ({"name": "Hardening Cable"}, "expected lower case and hyphens"),
        ({"meaning": ""}, "has no 'meaning'"),
        ({"parameters": ()}, "has no 'parameters'"),
    ],
)
def test_an_effect_that_says_too_little_is_refused(change, message):
    odd = type("Odd", (HardeningCable,), {"name": "odd-one", **change})
    with pytest.raises(ValueError, match=message):
        effects.register(odd())


def test_an_entry_point_registers_an_effect(monkeypatch):
    other = type("OtherCable", (HardeningCable,), {"name": "other-cable"})
    point = type("Point", (), {"name": "x", "value": "y:Z", "dist": None, "load": lambda self: other})()
    monkeypatch.setattr(effects, "entry_points", lambda group: [point] if group == "twin.effects" else [])
    monkeypatch.setattr(effects, "_BUILT_IN", ())
    effects._register_all()
    assert effects.REGISTRY["other-cable"].meaning == HardeningCable.meaning
    effects.unregister("other-cable")


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("raise ImportError('no z')", "ImportError: no z"),
        ("raise SystemExit(0)", "it ends the program, with exit code 0"),
        ("raise KeyboardInterrupt", "KeyboardInterrupt"),
        ("E = 3", "ValueError: 3 is no effect; expected an object of a subclass of twin.effects.Effect"),
        ("def E(): pass", "ValueError: <function E .*> is no effect"),
        (
            "class E:\n    def __init__(self):\n        raise BaseException('two\\nlines')",
            "BaseException: two lines",
        ),
        ("", "AttributeError: module 'broken_effect' has no attribute 'E'"),
    ],
)
def test_a_faulty_entry_point_is_named_with_its_package_and_stops_nothing(
    monkeypatch, tmp_path, code, message
):
    (tmp_path / "broken_effect.py").write_text(code)
    folder = tmp_path / "broken_effects-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Name: broken-effects\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("[twin.effects]\nbroken = broken_effect:E\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(effects, "_BUILT_IN", ())
    where = r"effect 'broken' of the package broken-effects \(broken_effect:E\) was not registered: "
    try:
        with pytest.warns(UserWarning, match=f"^{where}{message}"):
            effects._register_all()
    finally:
        sys.modules.pop("broken_effect", None)
    assert "broken" not in effects.REGISTRY
