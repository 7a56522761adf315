import re
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest
from paths import MODELS
from plants import BIAS, changed, torque_of

from twin.mechanics import beam, mjcf
from twin.mechanics.accuracy import linearised
from twin.mechanics.chain import build
from twin.mechanics.hub_law import HubLaw, HubTorque
from twin.mechanics.plant import declared_plant
from twin.recording import Sensor
from twin.rigs import mjcf_files, preset

RIG = preset("bossi2009")
CHAIN = build(RIG)
PLANT = declared_plant(RIG, CHAIN)


def _tokens(element: ET.Element) -> dict[str, list[str]]:
    return {"tag": [element.tag], **{name: value.split() for name, value in element.attrib.items()}}


def _same(name: str, found: str, expected: str) -> bool:
    number = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)?$")
    if not (number.match(found) and number.match(expected)):
        return found == expected
    # The sums of another processor are rounded otherwise, and the fit of the chain ends a little elsewhere. The
    # coefficients of a gauge are summed up: of a small one, the share of the others counts.
    return float(found) == pytest.approx(float(expected), rel=1e-3, abs=1e-4 if name == "coef" else 1e-7)


@pytest.mark.parametrize("name", ["bossi2009.xml", "scene.xml"])
def test_files_are_what_the_generator_writes(name, tmp_path):
    mjcf_files.write_models(tmp_path)
    trees = [list(ET.parse(folder / name).iter()) for folder in (tmp_path, MODELS)]
    assert len(trees[0]) == len(trees[1])
    for written, kept in zip(*trees, strict=True):
        assert _tokens(written).keys() == _tokens(kept).keys()
        for attribute, words in _tokens(written).items():
            pairs = list(zip(words, _tokens(kept)[attribute], strict=True))
            assert all(_same(attribute, *pair) for pair in pairs), (attribute, pairs)


@pytest.mark.parametrize("name", ["bossi2009.xml", "scene.xml"])
def test_files_open_and_swing_at_the_published_frequency(name):
    model = mujoco.MjModel.from_xml_path(str(MODELS / name))
    mass, _, stiffness = linearised(model)
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)
    assert np.sqrt(squares[1:3]) / (2 * np.pi) == pytest.approx([7.27, 18.21], rel=1e-4)


def test_model_has_the_chains_mass_stiffness_and_damping():
    mass, damping, stiffness = linearised(mjcf.dynamics_spec(CHAIN, PLANT, RIG).compile())
    np.testing.assert_allclose(mass, CHAIN.mass_matrix(), rtol=1e-10)
    np.testing.assert_allclose(np.diag(stiffness)[1:], CHAIN.stiffness, rtol=1e-7)
    np.testing.assert_allclose(damping[1:, 1:], CHAIN.damping, atol=1e-9 * CHAIN.damping.max())
    assert np.abs(damping[0]).max() < 1e-12


def test_compact_model_moves_alike():
    wide, compact = (linearised(mjcf.dynamics_spec(CHAIN, PLANT, RIG, compact=c).compile()) for c in (0, 1))
    for a, b in zip(wide, compact, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-8 * np.abs(a).max())


def test_losses_of_another_shape_are_written_too():
    damping = np.diag(np.linspace(1e-4, 2e-4, CHAIN.shape.segments))
    model = mjcf.dynamics_spec(CHAIN, PLANT.with_link(damping=damping), RIG).compile()
    np.testing.assert_allclose(linearised(model)[1][1:, 1:], damping, atol=1e-11)


def _bent(model: mujoco.MjModel, force: float) -> mujoco.MjData:
    """The link under a force across its tip [N], at rest."""
    data = mujoco.MjData(model)
    data.qpos[1:] = force * (RIG["length"] - CHAIN.hinges) / CHAIN.stiffness
    mujoco.mj_forward(model, data)
    return data


def test_strain_sensor_reads_half_thickness_times_curvature():
    gauge = Sensor("strain_base", position=0.02, half_thickness=0.0008)
    model = mjcf.build_spec(RIG, CHAIN, gauges=(gauge,)).compile()
    strain = _bent(model, 0.1).sensor("strain_base").data[0]
    expected = 0.0008 * 0.1 * (RIG["length"] - 0.02) / RIG["bending_stiffness"]
    assert strain == pytest.approx(expected, rel=2e-3)


def test_tip_sensor_sees_the_deflection_from_the_hub():
    data = _bent(mjcf.build_spec(RIG, CHAIN).compile(), 1e-3)
    assert data.sensor("tip_from_hub").data[1] == pytest.approx(
        1e-3 * beam.static_tip_compliance(RIG), rel=2e-4
    )


def test_motor_saturates_at_the_torque_limit():
    model = mjcf.build_spec(RIG, CHAIN).compile()
    data = mujoco.MjData(model)
    data.ctrl[model.actuator("motor").id] = 1.0
    mujoco.mj_forward(model, data)
    assert data.sensor("motor_torque").data[0] == pytest.approx(RIG["torque_limit"])


def test_plain_viewer_sees_coulomb_friction_without_creep():
    model = mjcf.build_spec(RIG, CHAIN).compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.9 * RIG["coulomb_friction"]
    mujoco.mj_step(model, data, 2000)
    assert abs(data.qpos[0]) < 1e-9


def test_file_carries_the_break_away_level():
    model = mjcf.build_spec(RIG, CHAIN).compile()
    assert model.numeric("static_friction").data[0] == RIG["static_friction"]


def test_what_mjcf_cannot_say_is_listed():
    torques = (torque_of("viscous-friction", viscous=0.01), HubTorque("brake", _brake, (0.1,)))
    augmented = changed(PLANT, {"softening": 0.2}, {"stribeck_velocity": 0.1}, torques=torques)
    expected = ("break-away friction above Coulomb", "Stribeck friction", "softening stiffness", "brake")
    assert mjcf.unsupported_mechanisms(augmented, torques) == expected


@HubLaw
def _brake(t, theta, omega, values):
    return -values[0] * omega * abs(omega)


def test_native_mechanisms_act_on_the_hub():
    torques = (
        torque_of("viscous-friction", viscous=0.01),
        torque_of("cable-torsion", stiffness=0.05, rest_angle=0.3),
        torque_of("cogging", amplitude=0.01, order=6.0, phase=0.4),
        BIAS,
    )
    model = mjcf.build_spec(RIG, CHAIN, changed(PLANT, torques=torques), torques).compile()
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = 0.7, 2.0
    mujoco.mj_forward(model, data)
    expected = 0.01 - 0.01 * 2.0 - 0.05 * (0.7 - 0.3) + 0.01 * np.sin(6 * 0.7 + 0.4)
    assert data.qfrc_smooth[0] + data.qfrc_bias[0] == pytest.approx(expected + data.qfrc_bias[0], abs=1e-12)


def test_scene_adds_table_and_cameras():
    model = mjcf.build_spec(RIG, CHAIN, scene=True).compile()
    assert model.geom("table").id >= 0
    assert model.ncam == 2


def test_plant_of_another_chain_is_refused():
    other = declared_plant(RIG, build(RIG.replace(tip_mass=0.2), shape=CHAIN.shape))
    with pytest.raises(ValueError, match="plant and chain have different inertias"):
        mjcf.build_spec(RIG, CHAIN, other)


def test_link_without_payload_and_losses_compiles():
    bare = {**RIG, "tip_mass": 0.0, "tip_inertia": 0.0, "damping_ratio": 0.0}
    links = build(bare, 4)
    assert mjcf.build_spec(bare, links).compile().nv == 5
