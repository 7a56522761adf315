import tomllib
from dataclasses import dataclass

import numpy as np
import pytest
from finite_elements import FiniteElementLink
from marks import slow_except
from paths import PUBLISHED
from scipy.linalg import eig
from scipy.signal import cont2discrete

from twin.mechanics.beam import modes, rigid_inertia, static_tip_compliance
from twin.mechanics.modal import (
    clamped_damping_ratios,
    clamped_state_space,
    released_state,
    state_space,
    zero_order_hold_response,
)
from twin.recording import Sensor
from twin.rigs import preset

BOSSI = tomllib.loads((PUBLISHED / "bossi2009.toml").read_text())
GAUGES = (Sensor("strain_base", None, 0.02, 0.0008), Sensor("strain_mid", None, 0.21, 0.0008))


@pytest.fixture
def rig():
    return preset("bossi2009")


@dataclass
class Oscillator:
    """x_tt + omega^2 x = u; y = (x, x_t)."""

    omega: float = 3.0

    def __post_init__(self):
        self.A = np.array([[0.0, 1.0], [-(self.omega**2), 0.0]])
        self.B = np.array([[0.0], [1.0]])
        self.C, self.D = np.eye(2), np.zeros((2, 1))


def strain_of(link, vector, gauge, rig):
    """Strain at a gauge: half thickness times curvature of the element that it is on."""
    h = link.nodes[1]
    e = min(int(gauge.position / h), len(link.nodes) - 2)
    w1, s1, w2, s2 = np.append(0.0, vector)[2 * e : 2 * e + 4]
    xi = gauge.position / h - e
    curvature = (12 * xi - 6) * (w1 - w2) / h**2 + (6 * xi - 4) * s1 / h + (6 * xi - 2) * s2 / h
    return gauge.half_thickness * curvature


def test_states_and_outputs_are_labelled(rig):
    system = state_space(rig, 2, GAUGES)
    assert system.state_labels == ["alpha", "delta_1", "delta_2", "alpha_t", "delta_1_t", "delta_2_t"]
    assert system.input_labels == ["torque"]
    assert system.output_labels == ["hub_angle", "tip_deflection", "strain_base", "strain_mid"]
    clamped = clamped_state_space(rig, 1, GAUGES[:1])
    assert clamped.state_labels == ["delta_1", "delta_1_t"]
    assert clamped.input_labels == ["tip_force"]
    assert clamped.output_labels == ["tip_deflection", "strain_base"]


@pytest.mark.parametrize("n", [1, 3, 8])
def test_poles_have_the_frequencies_and_the_declared_damping(rig, n):
    poles = state_space(rig, n).poles()
    flexible = np.sort_complex(poles[np.abs(poles) > 1e-6])
    np.testing.assert_allclose(np.unique(np.abs(flexible).round(6)), modes(rig, n).frequencies, rtol=1e-6)
    np.testing.assert_allclose(-flexible.real / np.abs(flexible), rig["damping_ratio"], rtol=1e-9)


@pytest.mark.parametrize("hz", [0.5, 3.0, 12.0, 30.0])
def test_response_to_torque_agrees_with_finite_elements(rig, hz):
    link = FiniteElementLink(rig, elements=120)
    omega = 2 * np.pi * hz
    vector = link.response(omega)
    expected = [vector[0], vector[-2] - rig["length"] * vector[0]]
    expected += [strain_of(link, vector, gauge, rig) for gauge in GAUGES]
    response = state_space(rig.replace(damping_ratio=0.0), 40, GAUGES)(1j * omega)[:, 0]
    # Forty modes leave out 1e-6 of the motion; curvature, linear within an element, is off by (b/120)^2/12.
    np.testing.assert_allclose(response[:2], expected[:2], rtol=1e-5)
    np.testing.assert_allclose(response[2:], expected[2:], rtol=1e-3)


def test_constant_torque_turns_the_whole_inertia_and_swings_the_modes(rig):
    system, flexible = state_space(rig.replace(damping_ratio=0.0), 2), modes(rig, 2)
    time, torque = np.linspace(0, 1, 30), 0.01
    angle = zero_order_hold_response(system, time, np.full(30, torque))[:, 0]
    compliance = flexible.shape(0.0, 1)[:, 0] ** 2 / flexible.frequencies**2
    swing = (1 - np.cos(np.outer(time, flexible.frequencies))) @ compliance
    np.testing.assert_allclose(angle, torque * (0.5 * time**2 / rigid_inertia(rig) + swing), atol=1e-12)


def test_static_tip_force_bends_the_clamped_link_as_a_cantilever(rig):
    system = clamped_state_space(rig, 30, GAUGES)
    deflection, *strains = system.dcgain()[:, 0]
    # Modes left out: compliance falls as b^-4 per mode, strain as b^-2.
    assert deflection == pytest.approx(static_tip_compliance(rig), rel=1e-6)
    for gauge, strain in zip(GAUGES, strains, strict=True):
        lever = rig["length"] - gauge.position
        assert strain == pytest.approx(gauge.half_thickness * lever / rig["bending_stiffness"], rel=1e-3)


def test_released_state_holds_the_deflection(rig):
    system = clamped_state_space(rig, 6)
    start = released_state(rig, 6, 0.02)
    assert (system.C @ start)[0] == pytest.approx(0.02, rel=1e-5)
    assert np.all(start[6:] == 0)


def test_clamped_damping_is_the_published_one(rig):
    assert f"{clamped_damping_ratios(rig, 1)[0]:.4f}" == BOSSI["reconciled"]["clamped_damping_ratio"]


@pytest.mark.parametrize("hub_inertia", slow_except([1e-9, 1e-4, 6.997e-4, 1e-2], 6.997e-4))
def test_clamped_damping_agrees_with_finite_elements(rig, hub_inertia):
    rig = rig.replace(hub_inertia=hub_inertia)
    link = FiniteElementLink(rig, elements=60)
    # Damp every free mode of the elements, then lock the hub and solve the damped eigenproblem.
    frequencies, vectors = link.modes(len(link.mass) - 1)
    momenta = link.mass @ vectors
    losses = (momenta * 2 * rig["damping_ratio"] * frequencies) @ momenta.T
    M, C, K = (matrix[1:, 1:] for matrix in (link.mass, losses, link.stiffness))
    zero, one = np.zeros_like(M), np.eye(len(M))
    poles = eig(np.block([[zero, one], [-K, -C]]), np.block([[one, zero], [zero, M]]), right=False)
    slowest = poles[poles.imag > 0]
    slowest = slowest[np.argsort(np.abs(slowest))][:3]
    # First order in zeta: what is neglected is zeta^2, 1e-3.
    ratios = -slowest.real / np.abs(slowest)
    np.testing.assert_allclose(clamped_damping_ratios(rig, 3), ratios, rtol=3e-3)


def test_clamped_damping_follows_the_free_one(rig):
    np.testing.assert_array_equal(clamped_damping_ratios(rig.replace(damping_ratio=0.0), 4), 0)
    twice = clamped_damping_ratios(rig.replace(damping_ratio=0.068), 4)
    np.testing.assert_allclose(twice, 2 * clamped_damping_ratios(rig, 4), rtol=1e-12)
    # A hub too heavy to move is locked.
    heavy = clamped_damping_ratios({**rig, "hub_inertia": 1e5}, 4)
    np.testing.assert_allclose(heavy, rig["damping_ratio"], rtol=1e-5)


@pytest.mark.parametrize("hub_inertia", [0.0, 6.997e-4])
def test_clamped_damping_does_not_depend_on_how_many_modes_are_asked_for(rig, hub_inertia):
    values = {**rig, "hub_inertia": hub_inertia}
    # Without hub inertia the sum converges as its length^-3.
    np.testing.assert_allclose(
        clamped_damping_ratios(values, 1), clamped_damping_ratios(values, 60)[:1], rtol=1e-4
    )


def test_ring_down_decays_by_the_clamped_damping(rig):
    system = clamped_state_space(rig, 1)
    omega, zeta = modes(rig, 1, "clamped").frequencies[0], clamped_damping_ratios(rig, 1)[0]
    period = 2 * np.pi / (omega * np.sqrt(1 - zeta**2))
    time = np.arange(11) * period
    swing = zero_order_hold_response(system, time, np.zeros(11), released_state(rig, 1, 0.02))[:, 0]
    decrement = 2 * np.pi * zeta / np.sqrt(1 - zeta**2)
    np.testing.assert_allclose(np.log(swing[:-1] / swing[1:]), decrement, rtol=1e-8)


def test_given_clamped_damping_is_used(rig):
    system = clamped_state_space(rig, 2, damping=[0.034, 0.01])
    poles = system.poles()
    ratios = -poles.real / np.abs(poles)
    np.testing.assert_allclose(np.unique(ratios.round(9)), [0.01, 0.034])


def test_held_step_is_the_closed_form():
    system = Oscillator()
    time = np.array([0.0, 0.1, 0.35, 0.36, 2.0])  # not uniform
    y = zero_order_hold_response(system, time, np.ones(5))
    expected = np.stack([(1 - np.cos(3 * time)) / 9, np.sin(3 * time) / 3], axis=1)
    np.testing.assert_allclose(y, expected, atol=1e-14)


def test_input_acts_from_its_sample_on():
    system = Oscillator()
    y = zero_order_hold_response(system, np.array([0.0, 0.1, 0.2]), [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(y[:2], 0)
    np.testing.assert_allclose(y[2], [(1 - np.cos(0.3)) / 9, np.sin(0.3) / 3], atol=1e-15)


def test_held_response_agrees_with_zero_order_hold(rig):
    system = state_space(rig, 3, GAUGES)
    time = np.arange(400) * 2e-3
    u = np.random.default_rng(0).normal(size=400)
    A, B, C, _, _ = cont2discrete((system.A, system.B, system.C, system.D), 2e-3)
    x, expected = np.zeros(8), []
    for torque in u:
        expected.append(C @ x)
        x = A @ x + B[:, 0] * torque
    np.testing.assert_allclose(zero_order_hold_response(system, time, u), expected, atol=1e-10)


def test_finer_sampling_of_the_same_torque_changes_nothing(rig):
    system = state_space(rig, 3)
    coarse = np.linspace(0, 0.5, 51)
    fine = np.linspace(0, 0.5, 501)
    u = np.sin(20 * coarse)
    held = np.append(np.repeat(u[:-1], 10), u[-1])
    y = zero_order_hold_response(system, coarse, u)
    np.testing.assert_allclose(
        zero_order_hold_response(system, fine, held)[::10], y, atol=1e-11 * np.abs(y).max()
    )


def test_wrong_number_of_inputs_is_refused():
    with pytest.raises(ValueError, match=r"inputs have shape \(3, 2\); expected \(3, 1\)"):
        zero_order_hold_response(Oscillator(), np.arange(3.0), np.zeros((3, 2)))
