"""A clamp that gives, as a hinge and as a condensed one, against finite elements and statics."""

import mujoco
import numpy as np
import pytest
from finite_elements import FiniteElementLink
from marks import slow_except
from scipy.linalg import eigh

from twin.estimation import chain_limit
from twin.mechanics import mjcf, planar
from twin.mechanics.chain import build, curvature_row, with_root_compliance
from twin.mechanics.plant import declared_plant
from twin.rigs import preset

RIG = preset("bossi2009")
CHAIN = build(RIG, 12)
SOFT, STIFF = 12.0, 75.0  # N m/rad, where the clamp is a hinge of its own, and where it is condensed


def compliant(stiffness, links=CHAIN):
    return with_root_compliance(links, RIG["hub_inertia"], stiffness)


def exact(stiffness, boundary):
    """First three frequencies [rad/s] of beam elements on a hub that holds them by a spring."""
    beam = FiniteElementLink(RIG)
    size = len(beam.mass) + 1
    mass, spring = np.zeros((size, size)), np.zeros((size, size))
    mass[1:, 1:], spring[1:, 1:] = beam.mass, beam.stiffness
    mass[1, 1] -= RIG["hub_inertia"]
    mass[0, 0] += RIG["hub_inertia"]
    spring[:2, :2] += stiffness * np.array([[1, -1], [-1, 1]])
    first = 1 if boundary == "clamped" else 0
    # A shift makes the stiffness of the free rig definite and is taken away again.
    squares = eigh((spring + mass)[first:, first:], mass[first:, first:], eigvals_only=True) - 1
    return np.sqrt(squares[1 - first : 4 - first])


def test_both_forms_are_used():
    assert len(compliant(SOFT).stiffness) == len(CHAIN.stiffness) + 1
    assert len(compliant(STIFF).stiffness) == len(CHAIN.stiffness)


@pytest.mark.parametrize("stiffness", [20.0, 60.0, 70.0, 75.0])
def test_chains_of_a_limit_treat_the_clamp_alike(stiffness):
    added = {len(compliant(stiffness, build(RIG, n)).stiffness) - n for n in chain_limit.PRECISE}
    assert len(added) == 1


@pytest.mark.parametrize("stiffness", slow_except([3.0, SOFT, 25.0, STIFF, 200.0], SOFT))
@pytest.mark.parametrize("boundary", ["free", "clamped"])
def test_frequencies_are_those_of_finite_elements(stiffness, boundary):
    # The chain's own error on a rigid clamp is 1e-5.
    found = compliant(stiffness).modes(boundary)[0][:3]
    np.testing.assert_allclose(found, exact(stiffness, boundary), rtol=1e-4)


@pytest.mark.parametrize("stiffness", [SOFT, STIFF])
def test_tip_force_turns_the_root(stiffness):
    exact = RIG["length"] ** 3 / (3 * RIG["bending_stiffness"]) + RIG["length"] ** 2 / stiffness
    assert compliant(stiffness).static_tip_compliance() == pytest.approx(exact, rel=2e-4)


@pytest.mark.parametrize("stiffness", [SOFT, STIFF])
def test_bridges_do_not_see_the_root_turn(stiffness):
    # Under a moment at the tip the strain is what it is on a rigid clamp.
    for position in (0.0, 0.02, 0.21):
        links = compliant(stiffness)
        seen = curvature_row(links, RIG, position) @ (1 / links.stiffness)
        rigid = curvature_row(CHAIN, RIG, position) @ (1 / CHAIN.stiffness)
        assert seen == pytest.approx(rigid, rel=1e-9)


def test_the_two_forms_meet():
    grid = np.linspace(1 / STIFF, 1 / SOFT, 400)
    forms = [compliant(1 / compliance) for compliance in grid]
    sizes = np.array([len(links.stiffness) for links in forms])
    first = np.array([links.modes("free")[0][0] for links in forms])
    k = int(np.flatnonzero(np.diff(sizes))[0])
    slope = (first[k] - first[k - 1]) / (grid[k] - grid[k - 1])
    # Where one form takes over from the other, the frequency jumps as if the compliance changed by less than 1 %.
    jump = first[k + 1] - first[k] - slope * (grid[k + 1] - grid[k])
    assert abs(jump) < 0.01 * grid[k] * abs(slope)


@pytest.mark.parametrize("stiffness", [SOFT, STIFF])
def test_mjcf_has_the_same_modes(stiffness):
    links = compliant(stiffness)
    plant = declared_plant(RIG, links)
    model = mjcf.build_spec(RIG, links, plant).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    squares = eigh(np.diag(model.jnt_stiffness), mass, eigvals_only=True)
    np.testing.assert_allclose(np.sqrt(squares[1:]), links.modes("free")[0], rtol=1e-8)


def test_file_of_a_soft_clamp_is_stable():
    links = compliant(4.0, build(RIG))
    model = mjcf.build_spec(RIG, links, declared_plant(RIG, links)).compile()
    data = mujoco.MjData(model)
    data.actuator("motor").ctrl = 0.1
    mujoco.mj_step(model, data, 2000)
    assert model.opt.timestep < mjcf.TIMESTEP
    assert np.abs(data.qvel).max() < 20


@pytest.mark.parametrize("stiffness", [SOFT, STIFF])
def test_runs_at_its_largest_step(stiffness):
    links = compliant(stiffness)
    plant = declared_plant(RIG, links)
    rest = np.zeros(len(links.lengths))
    run = (np.array([0.0]), np.array([0.15]), np.array([0.0, 0.3]), rest, rest, 1, False)
    coarse, fine = (planar.simulate(plant, *run, h)[0][-1] for h in (links.largest_step(), 5e-5))
    np.testing.assert_allclose(coarse, fine, atol=1e-4)
