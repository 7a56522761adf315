"""The link's linear response to forces, hub at rest, held against statics and against the coupled equations."""

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from twin.mechanics import chain, link_response
from twin.rigs import preset

PERIOD = 2e-3


@pytest.fixture(scope="module")
def link():
    return chain.build(preset("bossi2009"))


def on_tip(link, force):
    return (link.levers @ link.modes("clamped")[1][1:])[:, None] * force


def deflection(link, coordinates):
    return np.tensordot(link.levers @ link.modes("clamped")[1][1:], coordinates, 1)


def test_a_constant_force_ends_in_the_static_deflection(link):
    force = np.full(round(300 / PERIOD), 0.3)
    tip = deflection(link, link_response.modal_coordinates(link, on_tip(link, force), PERIOD))
    assert tip[-1] == pytest.approx(0.3 * link.static_tip_compliance(), rel=1e-5)


def test_response_and_acceleration_solve_the_coupled_equations(link):
    time = PERIOD * np.arange(1500)
    force = np.sin(9 * time) + np.sin(40 * time)
    mass, count = link.mass_matrix()[1:, 1:], len(link.stiffness)

    block, zero = np.linalg.solve(mass, np.c_[-np.diag(link.stiffness), -link.damping]), np.zeros((count, 1))
    slopes = np.r_[np.c_[np.zeros((count, count)), np.eye(count)], block]
    pull = np.linalg.solve(mass, link.levers[:, None])
    system = StateSpace(slopes, np.r_[zero, pull], np.eye(2 * count), np.zeros((2 * count, 1)))
    states = lsim(system, force, time)[1]  # exact for a force that is linear between two instants
    exact = states[:, :count] @ link.levers
    forces = on_tip(link, force)
    tip = deflection(link, link_response.modal_coordinates(link, forces, PERIOD))
    # Coupling of the modes by damping is neglected.
    np.testing.assert_allclose(tip, exact, atol=5e-3 * np.abs(exact).max())
    found = deflection(link, link_response.modal_coordinates(link, forces, PERIOD, accelerations=True))
    exact = (states @ block.T + force[:, None] * pull.T) @ link.levers
    np.testing.assert_allclose(found, exact, atol=2e-2 * np.abs(exact).max())
