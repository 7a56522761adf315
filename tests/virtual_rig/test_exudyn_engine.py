"""The second engine of the benchmarks against closed forms and against the virtual rig's own."""

import math

import cases
import diagnosis
import numpy as np
import pytest

from twin.errors import InputError
from twin.virtual_rig import Rig, Sensors
from twin.virtual_rig.campaign_writer import ritz_engine
from twin.virtual_rig.effects import switch_on
from twin.virtual_rig.experiments import Experiment

exudyn = pytest.importorskip("exudyn")
model = pytest.importorskip("exudyn_model")
rig = pytest.importorskip("exudyn_rig")

RIG, SENSORS = Rig(), Sensors()
FRICTIONLESS = RIG._replace(
    static_positive=0.0, static_negative=0.0, coulomb_positive=0.0, coulomb_negative=0.0
)


def experiment(commands, angle=0.3, **options):
    """Returns an open-loop experiment of the commands (samples,) [N m]."""
    return Experiment("trial", "trial", "fit", angle, np.asarray(commands, dtype=float), **options)


def both(true, plan):
    """Returns what the sensors are exposed to by Exudyn and by the virtual rig's own engine."""
    times = np.arange(len(plan.commands)) / SENSORS.sample_rate
    silence = np.zeros(len(times))
    return [engine(true, SENSORS, plan, times, silence) for engine in (rig.exudyn_engine, ritz_engine)]


def complex_modes(built, locked):
    """Returns frequencies [Hz] and damping ratios of the lowest modes of the linearised model."""
    built.system.SetObjectParameter(built.lock, "activeConnector", locked)
    mass, stiffness, damping = built.system.ComputeLinearizedSystem(projectIntoConstraintNullspace=True)[:3]
    zero, one = np.zeros_like(mass), np.eye(len(mass))
    system = np.block([[zero, one], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]])
    roots = np.linalg.eigvals(system)
    roots = roots[roots.imag > 1.0]
    roots = roots[np.argsort(np.abs(roots))]
    return np.abs(roots) / (2 * np.pi), -roots.real / np.abs(roots)


@pytest.mark.parametrize(
    ("locked", "exact"), [(False, [7.2700, 18.2101, 41.9335]), (True, [1.2430, 16.591, 41.116])]
)
def test_frequencies_are_those_of_the_exact_beam(locked, exact):
    """Tolerance: 0.1 %, and reached 0.03 %."""
    frequencies, _ = complex_modes(model.build(RIG, SENSORS, 0.3), locked)
    assert frequencies[:3] == pytest.approx(exact, rel=1e-3)


def test_free_modes_have_the_declared_damping():
    _, ratios = complex_modes(model.build(RIG, SENSORS, 0.3), locked=False)
    assert ratios[:5] == pytest.approx([RIG.damping_ratio] * 5, rel=0.01)


def test_locked_link_has_the_damping_of_the_same_losses():
    """0.0057, the logarithmic decrement of the virtual rig's own engine."""
    _, ratios = complex_modes(model.build(RIG, SENSORS, 0.0), locked=True)
    assert ratios[0] == pytest.approx(0.00567, rel=0.01)


def test_gauges_follow_the_modes_in_phase():
    """Between two modes, to 0.2 %. Damping moments constant within an element make the gauge at the base lag by 1 %."""
    t = np.arange(400) / SENSORS.sample_rate
    burst = 0.03 * np.sin(2 * np.pi * 16.0 * t) * np.sin(np.pi * t / t[-1])
    exudyn, own = both(FRICTIONLESS, experiment(burst))
    error = np.sqrt(np.mean((exudyn.strain - own.strain) ** 2, axis=0))
    assert np.all(error < 2e-3 * np.sqrt(np.mean(own.strain**2, axis=0)))


def test_small_static_deflection_is_the_cantilever_of_textbooks():
    """kappa = F (l - s)/EI with F = 3 EI y/l^3, at the gauges."""
    built = model.build(RIG, SENSORS, 0.0)
    model.hold_tip(built, RIG, 1e-4)
    rig_run = rig.Run(RIG, SENSORS, experiment(np.zeros(2), angle=0.0, tip_deflection=1e-4), rig.HubLaws(RIG))
    strains = rig_run.rows[0][2:4]
    places = np.array([SENSORS.position_base, SENSORS.position_mid])
    expected = SENSORS.half_thickness * 3 * 1e-4 / RIG.length**3 * (RIG.length - places)
    assert strains == pytest.approx(expected, rel=1e-4)


def test_gauges_lie_on_points_of_gauss():
    mesh = model.mesh_of(0.5, 0.03, 0.2)
    for element, place in mesh.gauges:
        length = np.diff(mesh.nodes)[element]
        assert abs(place / length - 0.5) == pytest.approx(0.5 / math.sqrt(3.0))
    assert [mesh.nodes[k] + place for k, place in mesh.gauges] == pytest.approx([0.03, 0.2])


def test_work_of_the_drive_is_the_energy_of_the_motion():
    """Without losses, from Exudyn's own mass matrix; tolerance: the step's."""
    lossless = FRICTIONLESS._replace(damping_ratio=0.0)
    run = rig.Run(lossless, SENSORS, experiment(np.zeros(2), angle=0.0), rig.HubLaws(lossless))
    run._command(0.0, 0.1)
    run._advance(0.15)
    work = 0.1 * run.angle
    mass = np.array(run.solver.GetSystemMassMatrix())
    kinetic = 0.5 * run.velocity @ mass @ run.velocity
    assert 0.0 < kinetic < work
    run._command(0.15, 0.0)
    energies = []
    for k in range(40):
        run._advance(0.15 + 0.01 * k)
        energies.append(0.5 * run.velocity @ mass @ run.velocity)
    assert max(energies) <= work * (1 + 1e-4)


def test_stuck_hub_does_not_creep():
    sensed, _ = both(RIG, experiment(np.full(300, 0.0649)))
    assert np.ptp(sensed.hub_angle) < 1e-12


def test_slew_with_stick_and_slip_is_that_of_the_other_engine():
    """RMS differences below the noise of 3e-4 rad and 2e-6: the strip of one engine is extensible."""
    commands = np.repeat([0.0, 0.15, -0.15, 0.0], [20, 100, 100, 130])
    exudyn, own = both(RIG, experiment(commands))
    assert np.ptp(own.hub_angle) > 0.2
    assert np.sqrt(np.mean((exudyn.hub_angle - own.hub_angle) ** 2)) < 0.3 * SENSORS.hub_noise
    rms = np.sqrt(np.mean((exudyn.strain - own.strain) ** 2, axis=0))
    assert np.all(rms < 0.7 * SENSORS.strain_noise)


EFFECTS = {
    "cogging": {"amplitude": 0.01, "order": 5, "phase": 0.9},
    "gravity-tilt": {"tilt": 0.02, "direction": 0.7},
    "shaking-base": {"amplitude": 0.3, "frequency": 4.0, "phase": 0.5},
    "torsional-mode": {"frequency": 26.0, "damping_ratio": 0.02, "inertia_share": 0.15},
    "root-compliance": {"stiffness": 20.0},
    "air-drag": {"coefficient": 0.2},
    "backlash": {"gap": 0.01, "motor_inertia_share": 0.4},
    "warming-link": {"loss": 0.1, "time_constant": 2.0},
    "actuator-delay": {"delay": 0.0113},
    "sensor-delay": {"delay": 0.0071},
    "actuator-lag": {"time_constant": 0.01},
    "bristles": {"stiffness": 10.0},
}


@pytest.mark.slow
@pytest.mark.parametrize("effect", EFFECTS)
def test_effect_is_that_of_the_other_engine(effect):
    """Two implementations of an effect differ by less than the noise, and by far less than the effect."""
    commands = np.repeat([0.0, 0.15, -0.15, 0.0], [20, 80, 80, 70])
    exudyn, own = both(switch_on(RIG, {effect: EFFECTS[effect]}), experiment(commands))
    plain = both(RIG, experiment(commands))[1]
    error = np.sqrt(np.mean((exudyn.hub_angle - own.hub_angle) ** 2))
    assert error < SENSORS.hub_noise
    share = 0.2 if effect == "backlash" else 0.1  # an impact is shorter than a step of either engine
    assert error < share * np.sqrt(np.mean((plain.hub_angle - own.hub_angle) ** 2))


def test_a_motor_within_its_play_does_not_keep_the_tip_from_being_held():
    loose = switch_on(RIG, {"backlash": EFFECTS["backlash"]})
    exudyn, own = both(loose, experiment(np.zeros(50), angle=0.0, tip_deflection=0.03))
    assert np.abs(exudyn.strain - own.strain).max() < 0.1 * SENSORS.strain_noise


def test_effect_that_exudyn_has_not_is_refused():
    soft = switch_on(RIG, {"softening-stiffness": {"softening": 0.2, "curvature": 1.0}})
    with pytest.raises(InputError, match="no softening-stiffness; expected"):
        both(soft, experiment(np.zeros(3)))


def test_engines_take_turns_but_for_effects_of_one():
    todo = list(cases.cases(4, 0, 8, 0, 0, 0, 11, 1, engines=diagnosis.ENGINES["both"]))
    made = [case.engine for case in todo]
    assert 0.4 < made.count("exudyn") / len(made) < 0.6
    for case in todo:
        if case.missing in [("softening-stiffness",), ("loose-payload",)]:
            assert case.engine == "virtual-rig"
    assert {case.torque_sensor for case in todo if case.engine == "exudyn"} == {True, False}


def test_table_tells_the_engines_apart():
    right = {"kind": "nothing", "missing": [], "verdict": "no-missing-effect", "adopted": []}
    alarm = right | {"verdict": "explained", "adopted": ["cogging"], "engine": "exudyn"}
    lines = diagnosis._by_engine([right, right, alarm])
    assert lines[1] == "| exactly right, by engine | nothing |"
    assert lines[3:] == ["| exudyn | 0 of 1 |", "| virtual-rig | 2 of 2 |"]
    assert diagnosis._by_engine([right]) == []
