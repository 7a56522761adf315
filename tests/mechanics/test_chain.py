import numpy as np
import pytest

from twin.mechanics import beam, chain
from twin.mechanics.chain import build, curvature_row, uniform_shape
from twin.rigs import preset

RIG = preset("bossi2009")


def _errors(links: chain.Chain, boundary: beam.Boundary) -> np.ndarray:
    return links.modes(boundary)[0][:3] / beam.modes(RIG, 3, boundary).frequencies - 1


@pytest.mark.parametrize("segments", [6, 8])
@pytest.mark.parametrize("boundary", ["free", "clamped"])
def test_few_fitted_segments_have_the_frequencies_of_the_beam(segments, boundary):
    assert np.abs(_errors(build(RIG, segments), boundary)).max() < 3e-5


def test_error_of_a_uniform_chain_falls_with_the_square_of_the_segments():
    errors = [_errors(build(RIG, n, uniform_shape(n)), "free")[1] for n in (8, 16)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)


def test_chain_is_as_compliant_as_the_beam():
    links = build(RIG)
    assert links.static_tip_compliance() == pytest.approx(beam.static_tip_compliance(RIG), rel=1e-4)


def test_rigid_chain_has_the_inertia_of_the_beam():
    assert build(RIG).mass_matrix()[0, 0] == pytest.approx(beam.rigid_inertia(RIG), rel=5e-4)


def test_segments_share_length_and_mass_of_the_link():
    links = build(RIG)
    assert links.lengths.sum() == pytest.approx(RIG["length"], rel=1e-12)
    assert links.masses.sum() == pytest.approx(RIG["linear_density"] * RIG["length"], rel=1e-12)


def test_every_free_mode_is_damped_as_declared():
    np.testing.assert_allclose(build(RIG).damping_ratios("free"), RIG["damping_ratio"], rtol=1e-9)


def test_same_losses_damp_the_clamped_link_less():
    assert build(RIG).damping_ratios("clamped")[0] == pytest.approx(0.0057, rel=0.01)


@pytest.mark.parametrize("x", [0.02, 0.21])
def test_curvature_under_a_tip_force_is_that_of_the_beam(x):
    links = build(RIG)
    # Hinge moments of a unit force at the tip, which EI w'' balances at x.
    bends = (RIG["length"] - links.hinges) / links.stiffness
    expected = (RIG["length"] - x) / RIG["bending_stiffness"]
    assert curvature_row(links, RIG, x) @ bends == pytest.approx(expected, rel=2e-3)


def test_runge_kutta_is_stable_with_the_largest_step():
    links = build(RIG)
    turn = 1j * links.modes()[0][-1] * links.largest_step()
    assert abs(1 + turn + turn**2 / 2 + turn**3 / 6 + turn**4 / 24) < 1


@pytest.mark.parametrize("boundary", ["free", "clamped"])
def test_slower_fast_modes_leave_all_else(boundary):
    links = build(RIG, shape=uniform_shape(16))
    slow = links.with_slower_modes(1e-3)
    assert links.largest_step() < 3e-4
    assert slow.largest_step() > 0.999e-3
    assert slow.modes(boundary)[0][:4] == pytest.approx(links.modes(boundary)[0][:4], rel=2e-3)
    assert slow.modes("free")[0][:4] == pytest.approx(links.modes("free")[0][:4], rel=1e-9)
    assert slow.inertia.sum() == pytest.approx(links.inertia.sum(), rel=1e-12)


def test_a_chain_that_is_stable_has_no_slower_modes():
    links = build(RIG, 5)
    assert links.with_slower_modes(0.99 * links.largest_step()) is links


def test_one_segment_is_not_a_chain():
    with pytest.raises(ValueError, match="At least 2 segments required. Received 1"):
        build(RIG, 1)
