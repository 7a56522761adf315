"""The link's linear response to forces, hub at rest, held against statics and against the coupled equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

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

    def slope(t, z):
        pull = link.levers * np.interp(t, time, force)
        bend = np.linalg.solve(mass, pull - link.stiffness * z[:count] - link.damping @ z[count:])
        return np.r_[z[count:], bend]

    solved = solve_ivp(slope, time[[0, -1]], np.zeros(2 * count), "LSODA", time, rtol=1e-8, atol=1e-10)
    exact = link.levers @ solved.y[:count]
    forces = on_tip(link, force)
    tip = deflection(link, link_response.modal_coordinates(link, forces, PERIOD))
    # Coupling of the modes by damping is neglected.
    np.testing.assert_allclose(tip, exact, atol=5e-3 * np.abs(exact).max())
    found = deflection(link, link_response.modal_coordinates(link, forces, PERIOD, accelerations=True))
    exact = link.levers @ np.array([slope(t, z)[count:] for t, z in zip(time, solved.y.T, strict=True)]).T
    np.testing.assert_allclose(found, exact, atol=2e-2 * np.abs(exact).max())
