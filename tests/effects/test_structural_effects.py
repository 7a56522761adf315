"""The effects that change the structure of the rig, against the virtual rig, which shares no code with them."""

import numpy as np
import pytest

from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import Recording, Sensor
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.simulate import simulate
from twin.virtual_rig import beam, effects, plant, sensors
from twin.virtual_rig.rig import Rig, declared_values

QUIET = sensors.Sensors(hub_step=0.0, strain_step=0.0, torque_step=0.0)
GAUGES = {
    "strain_base": Sensor("strain_base", QUIET.strain_noise, QUIET.position_base, QUIET.half_thickness),
    "strain_mid": Sensor("strain_mid", QUIET.strain_noise, QUIET.position_mid, QUIET.half_thickness),
}
NOISE = {"hub_angle": QUIET.hub_noise, "strain_base": QUIET.strain_noise, "strain_mid": QUIET.strain_noise}
SEEN = dict(zip(("strain_base", "strain_mid"), sensors.TORSION_STRAIN, strict=True))
FLANKS = {"contact_stiffness": plant.CONTACT_STIFFNESS, "contact_damping": plant.CONTACT_LOSS}

# Effect, parameters, and how far apart the two may be in noise levels (rms): the plain chain is 0.2 off, and
# each contact in a play makes more of what went before.
CASES = {
    "soft clamp": ("root-compliance", {"stiffness": 8.0}, 0.3),
    "stiff clamp": ("root-compliance", {"stiffness": 50.0}, 0.4),
    "torsional mode": (
        "torsional-mode",
        {"frequency": 26.0, "damping_ratio": 0.02, "inertia_share": 0.15},
        0.3,
    ),
    "backlash": ("backlash", {"gap": 0.01, "motor_inertia_share": 0.4}, 1.0),
}


def readings(name, parameters, time, command):
    """What the virtual rig's sensors read without noise."""
    rig = effects.switch_on(Rig(), {name: parameters})
    link = beam.build_link(rig)
    rest = plant.at_rest(rig, link, 0.0, np.zeros(len(link.stiffness)))
    motion = plant.simulate(rig, link, rest, time, command)
    silence = dict.fromkeys((*NOISE, "motor_torque"), np.zeros(len(time)))
    return sensors.measured(rig, link, QUIET, time, motion, silence)


@pytest.mark.parametrize("case", CASES)
def test_slew_is_that_of_the_virtual_rig(case):
    name, parameters, limit = CASES[case]
    time = np.arange(0, 0.8, 0.002)
    command = np.where(time < 0.35, 0.15, -0.14)
    exact = readings(name, parameters, time, command)
    known = {"torsional-mode": SEEN, "backlash": FLANKS}.get(name, {})
    rig = preset("bossi2009").replace(**declared_values(Rig()))
    model = Model(rig, GAUGES, chain.fit_shape(rig, 12), {name: {**parameters, **known}}, step=2.5e-4)
    asked = Recording("", time, {"torque_command": command, **{c: 0 * time for c in NOISE}})
    found = simulate(model, asked, Start())
    plain = simulate(model.replace(effects={}), asked, Start())
    for channel, noise in NOISE.items():
        off = np.sqrt(np.mean((found[channel] - exact[channel]) ** 2)) / noise
        without = np.sqrt(np.mean((plain[channel] - exact[channel]) ** 2)) / noise
        assert off < limit
        assert without > 5 * off


@pytest.mark.parametrize("soft", [False, True])
def test_the_shape_of_a_held_link_is_that_of_the_virtual_rig(soft):
    """A release from 5 cm: the strains at rest, of a link that softens by a tenth there."""
    law = {"softening-stiffness": {"softening": 0.34, "curvature": 0.76}} if soft else {}
    exact = effects.switch_on(Rig(), law)
    link = beam.build_link(exact, *beam.basis_of(exact))
    shape = beam.deflected_shape(exact, link, 0.05)
    places = np.array([GAUGES[c].position for c in ("strain_base", "strain_mid")])
    strains = beam.curvature_at(exact, places, len(shape)) @ shape * GAUGES["strain_base"].half_thickness
    rig = preset("bossi2009").replace(**declared_values(Rig()))
    model = Model(rig, GAUGES, chain.fit_shape(rig, 16), law, step=2.5e-4)
    time = np.arange(0, 0.01, 0.002)
    nothing = {"torque_command": 0 * time, **{c: 0 * time for c in NOISE}}
    asked = Recording("", time, nothing, clamped=True, initial_tip_deflection=0.05)
    held = simulate(model, asked, Start())
    assert [held[c][0] for c in ("strain_base", "strain_mid")] == pytest.approx(strains, rel=2e-3)
