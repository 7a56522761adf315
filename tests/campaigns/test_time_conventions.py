"""When a command acts and when a sensor reads, against the exact response of the linear chain."""

import numpy as np
import pytest
from rig_campaigns import planned

from twin.diagnosis import candidates
from twin.estimation.calibrate import calibrate, likeliest_clock
from twin.estimation.residual_pool import ResidualPool
from twin.mechanics import chain
from twin.mechanics.modal import zero_order_hold_response
from twin.mechanics.mujoco_chain import MujocoChain
from twin.mechanics.state import Start
from twin.recording import Recording, Sensor
from twin.residuals import residual
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID
from twin.residuals.prepared import prepare
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.simulate import simulate
from twin.virtual_rig import Rig, Sensors
from twin.virtual_rig.experiments import bang_bang

RIG = preset("bossi2009").replace(static_friction=0.0, coulomb_friction=0.0)
SHAPE = chain.fit_shape(RIG, 6)


class LinearChain:
    """State space of the chain at small angles: [hub, hinges, rates], torque in, hub angle out."""

    def __init__(self):
        links = chain.build(RIG, shape=SHAPE)
        mass, n = links.mass_matrix(), len(links.lengths)
        stiffness, damping = np.zeros((n, n)), np.zeros((n, n))
        stiffness[1:, 1:], damping[1:, 1:] = np.diag(links.stiffness), links.damping
        self.A = np.block(
            [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(mass, np.hstack([stiffness, damping]))]]
        )
        self.B = np.r_[np.zeros(n), np.linalg.solve(mass, np.eye(n)[:, 0])][:, None]
        self.C = np.eye(2 * n)[:1]
        self.D = np.zeros((1, 1))


def commanded(time):
    """A small random torque, so that angles stay small [N m]."""
    return 1e-4 * np.random.default_rng(3).normal(size=len(time))


def instants(kind):
    """Sample times, uniform or scattered [s]."""
    uniform = np.arange(0, 0.6, 0.002)
    scatter = np.random.default_rng(4).uniform(0, 6e-4, len(uniform))
    return uniform if kind == "uniform" else uniform + scatter


def delay_of(angle, exact, time):
    """How much later `angle` is than `exact` [s], by least squares."""
    rate = np.gradient(exact, time)
    return -float(np.sum((angle - exact) * rate) / np.sum(rate**2))


@pytest.mark.parametrize("kind", ["uniform", "scattered"])
def test_a_command_acts_from_its_sample_to_the_next_and_a_reading_is_of_its_instant(kind):
    time = instants(kind)
    recording = Recording("", time, {"torque_command": commanded(time), "hub_angle": np.zeros_like(time)})
    model = Model(RIG, {}, SHAPE, step=2.5e-4)
    angle = simulate(model, recording, Start())["hub_angle"]
    exact = zero_order_hold_response(LinearChain(), time, commanded(time))[:, 0]
    assert abs(delay_of(angle, exact, time)) < 1e-6


def test_mujoco_keeps_the_same_time():
    time = instants("uniform")
    links = chain.build(RIG, shape=SHAPE)
    model = Model(RIG, {}, SHAPE)
    engine = MujocoChain(RIG, links, model.plant, model.hub_torques)
    start = np.zeros(len(links.lengths))
    angles, _, _ = engine.simulate(time, commanded(time), time, start, start, 0, False, 2.5e-4)
    exact = zero_order_hold_response(LinearChain(), time, commanded(time))[:, 0]
    assert abs(delay_of(angles[:, 0], exact, time)) < 1e-6


def test_a_delay_is_seen_as_a_delay():
    # The measure itself: half a millisecond must not pass.
    time = instants("uniform")
    recording = Recording("", time, {"torque_command": commanded(time), "hub_angle": np.zeros_like(time)})
    late = Model(RIG, {}, SHAPE, {"actuator-delay": {"delay": 5e-4}}, step=2.5e-4)
    angle = simulate(late, recording, Start())["hub_angle"]
    exact = zero_order_hold_response(LinearChain(), time, commanded(time))[:, 0]
    assert delay_of(angle, exact, time) == pytest.approx(5e-4, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("slew", "seed"), [("bang-bang-60", 3), ("bang-bang-90", 4)])
def test_declared_parameters_that_are_off_do_not_hide_on_which_clock_commands_were_held(
    rig_campaign, slew, seed
):
    campaign = rig_campaign({}, seed, experiments=planned(30044, slew), perturb=1.5, dirty=["jitter"]).read()
    with ResidualPool(1) as pool:
        assert calibrate(campaign, pool).clock == "stamped"


@pytest.mark.slow
@pytest.mark.parametrize("first", ["stamped", "earliest"])
def test_the_clock_is_asked_again_with_what_the_model_lacked(rig_campaign, first):
    """A friction that varies with the angle may be followed better on a wrong clock, until it is in the model."""
    draw = np.random.default_rng(3)
    slews = [bang_bang(Rig(), Sensors(), draw, angle) for angle in (60.0, 90.0)]
    waves = {"position-dependent-friction": {"amplitude": 0.015, "order": 7.0, "phase": -1.9}}
    campaign = rig_campaign(waves, 3, experiments=slews, perturb=0.5, dirty=["jitter"]).read()
    with ResidualPool(1) as pool:
        start = calibrate(campaign, pool, clock=first)
        assert start.clock == first
        found = candidates.try_effect(start.bench, start.base, "position-dependent-friction")
        assert likeliest_clock(start, found.fit) == "stamped"


def test_a_late_sensor_and_a_late_drive_leave_the_same_though_a_run_ends_in_motion():
    time, samples, noise = np.arange(0, 3.0, GRID), 4, 3e-4
    channels = ("torque_command", "hub_angle", "strain_base")
    asked = Recording("", time, {c: np.zeros_like(time) for c in channels})
    torque = np.where(time < 0.5, 0.0, 0.1 * np.sin(2 * np.pi * 7 * time))
    resonant = asked.replace(channels={**asked.channels, "torque_command": torque})
    sensors = {"strain_base": Sensor("strain_base", position=0.02, half_thickness=0.0008)}
    rig = preset("bossi2009")
    model = Model(rig, sensors, chain.fit_shape(rig, 5), step=2.5e-4)
    late = {"delay": samples * GRID}
    late_sensor = {"sensor-delay": {**late, "hub_angle": 1.0, "strain": 1.0, "motor_torque": 0.0}}
    sensor, drive = model.replace(effects=late_sensor), model.replace(effects={"actuator-delay": late})
    read = dict(simulate(sensor, resonant, Start()).channels)
    read["hub_angle"] = read["hub_angle"] + np.random.default_rng(5).normal(scale=noise, size=len(time))
    measured = resonant.replace(channels=read)
    prepared, _ = prepare(measured, {"hub_angle": noise, "strain_base": 2e-6})
    [view] = DrivenData.of([prepared], model).views
    [first, then] = [residual.raw_residual(view, prepared, m, prepared.start) for m in (sensor, drive)]
    # Both residuals stand at the time of the reading, on whose clock it is known where the hub slides.
    shown = np.flatnonzero(view.sliding)
    off = first["hub_torque"][shown] - then["hub_torque"][shown]
    assert shown[-1] > len(time) - 0.1 / GRID
    assert np.abs(off).max() < 0.01 * view.noise["hub_torque"]
    # What the filters make of the end would be whitened together with all the rest.
    assert np.abs(then["hub_torque"]).max() < 5 * view.noise["hub_torque"]
    strains = first["strain_base"] - then["strain_base"]
    assert np.abs(strains[shown]).max() < view.noise["strain_base"]
