"""Plants behind one interface: they move alike where they should, and each as its own equations say."""

import numpy as np
import pytest

from twin.control.plants import make_plant
from twin.control.plants.base import READINGS
from twin.control.plants.chain import ChainPlant, CompiledPlant
from twin.control.plants.modal import ModalPlant
from twin.control.plants.paper import PaperPlant
from twin.errors import InputError
from twin.mechanics import chain
from twin.mechanics.beam import rigid_inertia
from twin.recording import GAUGES
from twin.rigs import preset
from twin.rigs.model import Model

PLANTS = (ChainPlant, CompiledPlant, ModalPlant, PaperPlant)
RIG = preset("bossi2009")


def model(effects=None, **changes) -> Model:
    rig = RIG.replace(**changes)
    return Model(rig, {g.channel: g for g in GAUGES}, chain.fit_shape(rig, 6), effects or {})


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"cable": {}}, "effects.cable is not an effect; expected one of"),
        (
            {"cogging": {"amplitud": 0.01}},
            "unknown key effects.cogging.amplitud; .* did you mean 'amplitude'",
        ),
        ({"cogging": {"amplitude": "big"}}, "effects.cogging.amplitude is 'big'; expected a number"),
        ({"cogging": {"amplitude": np.nan}}, "effects.cogging.amplitude is nan; expected a number"),
        ({"cogging": 0.01}, "effects.cogging is 0.01; expected a table"),
    ],
)
def test_effects_that_are_none_are_refused(effects, message):
    with pytest.raises(InputError, match=message):
        make_plant("modal", RIG, effects)


@pytest.mark.slow
def test_what_is_not_said_of_an_effect_is_neutral():
    whole = make_plant("modal", RIG, {"cable-torsion": {"stiffness": np.float32(0.25), "rest_angle": 0.0}})
    part = make_plant("modal", RIG, {"cable-torsion": {"stiffness": 0.25}})
    for channel, values in slew(whole, 0.1)[0].items():
        np.testing.assert_array_equal(slew(part, 0.1)[0][channel], values)


def slew(plant, torque, times=(0.3, 0.6), duration=1.2):
    """Readings (m) by channel and modes (m) under +torque until times[0], then -torque until times[1]."""
    plant.reset()
    readings, modes = [], []
    while plant.time() < duration - 1e-9:
        now = plant.time() + 1e-9
        plant.advance(torque if now < times[0] else (-torque if now < times[1] else 0.0))
        readings.append(plant.read())
        modes.append(plant.mode)
    return {name: np.array([r[name] for r in readings]) for name in READINGS}, np.array(modes)


@pytest.mark.parametrize("kind", PLANTS)
def test_hub_rests_below_break_away(kind):
    readings, modes = slew(kind(model()), 0.06)
    assert np.ptp(readings["hub_angle"]) < 1e-9
    assert not modes.any()


@pytest.mark.parametrize("kind", PLANTS)
def test_amplifier_limits_the_torque(kind):
    readings, modes = slew(kind(model()), 5.0)
    assert np.abs(readings["motor_torque"]).max() == pytest.approx(RIG["torque_limit"])
    assert {-1, 0, 1} >= set(modes)
    assert readings["hub_angle"].max() > 0.3


def test_compiled_chain_moves_as_mujoco():
    one, _ = slew(ChainPlant(model()), 0.15)
    other, _ = slew(CompiledPlant(model()), 0.15)
    assert np.abs(one["hub_angle"] - other["hub_angle"]).max() < 1e-4


def test_modes_move_as_the_chain_while_the_link_bends_little():
    small = model(static_friction=0.0, coulomb_friction=0.0)
    one, _ = slew(ModalPlant(small), 0.01)
    other, _ = slew(CompiledPlant(small), 0.01)
    for name in ("hub_angle", "tip_deflection", "strain_base"):
        assert np.abs(one[name] - other[name]).max() < 5e-3 * np.ptp(other[name])


@pytest.mark.slow
def test_modal_motion_does_not_depend_on_the_sample_period():
    coarse, _ = slew(ModalPlant(model(), period=4e-3), 0.15)
    fine, _ = slew(ModalPlant(model(), period=1e-3), 0.15)
    np.testing.assert_allclose(coarse["hub_angle"], fine["hub_angle"][3::4], atol=1e-8)


def test_energy_of_a_sliding_modal_hub_is_lost_to_friction_alone():
    """Without losses in the link, work of the motor less friction is the energy of the modes."""
    lossless = model(damping_ratio=0.0, static_friction=0.01, coulomb_friction=0.01)
    plant = ModalPlant(lossless, period=1e-3)
    plant.reset()
    work, before = 0.0, 0.0
    for _ in range(300):
        plant.advance(0.05)
        turned = plant.read()["hub_angle"] - before
        before += turned
        work += 0.05 * turned - 0.01 * abs(turned)
    q, rates = plant._z[:4], plant._z[4:8]
    kinetic = 0.5 * rigid_inertia(lossless.rig) * rates[0] ** 2 + 0.5 * rates[1:] @ rates[1:]
    omega = np.sqrt(-np.diag(plant._sliding[4:8, :4]))
    assert kinetic + 0.5 * np.sum((omega * q) ** 2) == pytest.approx(work, rel=1e-4)


@pytest.mark.slow
def test_delayed_command_acts_late_on_every_plant():
    late = model({"actuator-delay": {"delay": 0.0213}})
    for kind in PLANTS:
        readings, _ = slew(kind(late), 0.15)
        first = np.argmax(readings["motor_torque"] > 0) * 2e-3
        assert first == pytest.approx(0.02, abs=2.1e-3)


def test_outline_ends_at_the_tip():
    for kind in PLANTS:
        plant = kind(model())
        plant.reset(0.5)
        for _ in range(100):
            plant.advance(0.2)
        end = plant.outline(plant.configuration[None])[0, -1]
        theta, w = plant.read()["hub_angle"], plant.read()["tip_deflection"]
        across = -np.sin(theta) * end[0] + np.cos(theta) * end[1]
        assert across == pytest.approx(w, abs=1e-9)
