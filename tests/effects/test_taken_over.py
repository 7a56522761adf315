"""Where an effect is left out, other parameters take its place."""

import numpy as np
import pytest

from twin.effects import REGISTRY
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import Recording, Sensor
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

EFFECTS = {
    "viscous-friction": {"viscous": 0.02},
    "cable-torsion": {"stiffness": 0.03, "rest_angle": 0.4},
    "position-dependent-friction": {"amplitude": 0.01, "order": 2.0, "phase": 0.3},
    "torsional-mode": {"inertia_share": 0.1, "frequency": 30.0, "damping_ratio": 0.02},
}


def motion(rig, effects, torque):
    time = np.arange(len(torque)) / 500
    asked = Recording("", time, {"torque_command": torque, "hub_angle": 0 * time}, loop="open")
    model = Model(rig, {"hub_angle": Sensor("hub_angle")}, chain.fit_shape(rig, 5), effects, step=2e-3)
    return simulate(model, asked, Start())["hub_angle"]


def without(name, values, rig, effects):
    """The rig and its effects where parameters have taken over from an effect."""
    left_out = REGISTRY[name]
    moved = rig.replace(
        **{
            n: left_out.taken_over(values, n, p.value, p.unit)
            for n, p in rig.parameters.items()
            if n != "torque_limit"
        }
    )
    others = {
        effect: {
            n: left_out.taken_over(values, f"{effect}.{n}", v, REGISTRY[effect].units(p)[n])
            for n, v in p.items()
        }
        for effect, p in effects.items()
    }
    return moved, others


@pytest.mark.parametrize("gain", [0.8, 1.15])
def test_a_gain_is_a_unit_of_mass(gain):
    rig, values = preset("bossi2009"), {"gain": gain, "behind_sensor": 0.0}
    torque = 0.13 * np.sign(np.sin(5 * np.arange(1000) / 500))
    gained = motion(rig, {**EFFECTS, "torque-gain": values}, torque)
    assert np.ptp(gained) > 0.5
    alone = motion(rig, EFFECTS, torque)
    assert np.abs(alone - gained).max() > 0.05
    # Differences are those of a step that ends where the hub stops.
    np.testing.assert_allclose(
        motion(*without("torque-gain", values, rig, EFFECTS), torque), gained, atol=1e-5
    )


def test_a_dead_zone_is_friction_where_the_drive_pushes():
    rig, values = preset("bossi2009"), {"half_width": 0.01}
    torque = np.full(30, 0.13)  # before the link makes the hub turn back
    gained = motion(rig, {"dead-zone": values}, torque)
    moved, _ = without("dead-zone", values, rig, {})
    assert moved["coulomb_friction"] == pytest.approx(rig["coulomb_friction"] + 0.01)
    np.testing.assert_allclose(motion(moved, {}, torque), gained, atol=1e-6)
