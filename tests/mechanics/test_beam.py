import itertools
import time
import tomllib

import numpy as np
import pytest
from finite_elements import FiniteElementLink
from paths import PUBLISHED
from scipy.optimize import brentq

from twin.mechanics.beam import modes, rigid_inertia, static_tip_compliance
from twin.rigs import preset

BOSSI = tomllib.loads((PUBLISHED / "bossi2009.toml").read_text())
ROOTS = tomllib.loads((PUBLISHED / "beam_roots.toml").read_text())
BARE = {
    "bending_stiffness": 2.0,
    "linear_density": 0.3,
    "length": 0.7,
    "hub_inertia": 0.0,
    "tip_mass": 0.0,
    "tip_inertia": 0.0,
}
BOUNDARIES = ("free", "clamped")
# End inertias relative to those of the link, from none to a thousand times as much.
RATIOS = list(itertools.product((0.0, 1e-3, 1.0, 1e3), repeat=3))
EXTREME = [(1e-9, 1e9, 1e-9), (1e9, 1e9, 1e9), (1e9, 0.0, 1e9)]


def half_digit(printed):
    """Largest error that rounding to the printed digits explains."""
    digits = printed.split("e")[0].partition(".")[2]
    exponent = int(printed.split("e")[1]) if "e" in printed else 0
    return 0.5001 * 10.0 ** (exponent - len(digits))


def matches(value, printed):
    return abs(value - float(printed)) <= half_digit(printed)


def loaded(hub, mass, inertia):
    """The bare link with end inertias relative to its own."""
    link = BARE["linear_density"] * BARE["length"]
    about_end = link * BARE["length"] ** 2
    return {
        **BARE,
        "hub_inertia": hub * about_end,
        "tip_mass": mass * link,
        "tip_inertia": inertia * about_end,
    }


def quadrature(length, cells=40):
    """Gauss-Legendre points and weights, exact to rounding for twenty modes."""
    points, weights = np.polynomial.legendre.leggauss(8)
    starts = np.arange(cells)[:, None]
    x = (starts + (points + 1) / 2) * length / cells
    return x.ravel(), np.tile(weights * length / cells / 2, cells)


def modal_masses(rig, m):
    """Modal mass matrix by quadrature (n x n)."""
    x, weights = quadrature(rig["length"])
    phi, tip, tip_slope = m.shape(x), m.shape(rig["length"]), m.shape(rig["length"], 1)
    mass = rig["linear_density"] * (phi * weights) @ phi.T
    mass += rig["tip_mass"] * tip @ tip.T + rig["tip_inertia"] * tip_slope @ tip_slope.T
    hub_slope = m.shape(0.0, 1)
    return mass + (rig["hub_inertia"] * hub_slope @ hub_slope.T if m.boundary == "free" else 0.0)


@pytest.mark.parametrize("case", BOSSI["frequencies"], ids=lambda c: f"{c['preset']}-{c['boundary']}")
def test_frequencies_are_the_published_ones(case):
    rig = preset(case["preset"])
    # The inertias are published rounded, and the frequencies belong to the rounded ones.
    rounded = {**rig, **case["inertias"]}
    hz = modes(rounded, len(case["hz"]), case["boundary"]).frequencies / (2 * np.pi)
    for found, printed in zip(hz, case["hz"], strict=True):
        assert matches(found, printed), (found, printed)
    # Solved to all digits instead, they move by less than 2e-5: half a digit of 6.997e-4 is 7e-5 of it.
    solved = modes(rig, len(case["hz"]), case["boundary"]).frequencies / (2 * np.pi)
    np.testing.assert_allclose(solved, hz, rtol=2e-5)


@pytest.mark.parametrize(
    ("name", "boundary", "rig", "skip"),
    [
        ("clamped_free", "clamped", BARE, 0),
        ("pinned_free", "free", BARE, 0),
        # A payload of 1e12 link masses does not move: the tip is pinned, below it is one slow mode.
        ("clamped_pinned", "clamped", loaded(0, 1e12, 0), 1),
        ("pinned_pinned", "free", loaded(0, 1e12, 0), 0),
        ("clamped_clamped", "clamped", loaded(0, 1e12, 1e12), 2),
        ("clamped_free", "free", loaded(1e12, 0, 0), 0),
    ],
)
def test_roots_are_those_of_the_textbook(name, boundary, rig, skip):
    roots = modes(rig, 5 + skip, boundary).roots[skip:]
    for found, printed in zip(roots, ROOTS[name], strict=True):
        assert matches(found, printed), (found, printed)


def test_textbook_roots_continue_to_any_number():
    # cos b cosh b = -1 tends to (i - 1/2) pi, tan b = tanh b to (i + 1/4) pi, exponentially.
    i = np.arange(1, 201)
    np.testing.assert_allclose(modes(BARE, 200, "clamped").roots[9:], (i[9:] - 0.5) * np.pi, rtol=1e-13)
    np.testing.assert_allclose(modes(BARE, 200).roots[9:], (i[9:] + 0.25) * np.pi, rtol=1e-13)


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("name", ["bossi2009", "bossi2009-printed"])
def test_modes_agree_with_finite_elements(name, boundary):
    rig = preset(name)
    link = FiniteElementLink(rig, elements=60)
    frequencies, vectors = link.modes(4, boundary)
    exact = modes(rig, 4, boundary)
    # Hermite elements are off by (b / 60)^4 / 720 of the squared frequency: 4e-7 for b = 8.
    np.testing.assert_allclose(frequencies, exact.frequencies, rtol=1e-6)
    shapes, found = exact.shape(link.nodes), link.deflections(vectors)
    found *= np.sign(np.sum(found * shapes, axis=1))[:, None]
    np.testing.assert_allclose(found, shapes, atol=1e-5 * np.abs(shapes).max())


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("ratios", RATIOS, ids=str)
def test_no_mode_is_missed(ratios, boundary):
    rig = loaded(*ratios)
    frequencies, _ = FiniteElementLink(rig, elements=40).modes(8, boundary)
    exact = modes(rig, 8, boundary).frequencies
    # Elements: 5e-4 for b = 30; rounding in matrices with entries a thousand times apart: 1e-6.
    np.testing.assert_allclose(frequencies, exact, rtol=1e-3)


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("ratios", [*RATIOS, *EXTREME], ids=str)
def test_twenty_modes_are_orthonormal(ratios, boundary):
    rig = loaded(*ratios)
    m = modes(rig, 20, boundary)
    # A slope at an end is right to rounding, 1e-16 b^(3/2), and counts with the root of the inertia there.
    rounding = 1e-16 * m.roots[-1] ** 1.5 * np.sqrt(max(1.0, *ratios))
    np.testing.assert_allclose(modal_masses(rig, m), np.eye(20), atol=100 * rounding)


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_strain_energy_is_the_squared_frequency(boundary):
    rig = preset("bossi2009")
    m = modes(rig, 10, boundary)
    x, weights = quadrature(rig["length"])
    curvature = m.shape(x, 2)
    stiffness = rig["bending_stiffness"] * (curvature * weights) @ curvature.T
    np.testing.assert_allclose(stiffness, np.diag(m.frequencies**2), atol=1e-10 * m.frequencies[-1] ** 2)


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("derivative", range(4))
def test_each_derivative_integrates_to_the_one_below(derivative, boundary):
    rig = preset("bossi2009")
    m = modes(rig, 8, boundary)
    x, weights = quadrature(0.3)
    gained = m.shape(0.3, derivative) - m.shape(0.0, derivative)
    integral = m.shape(x, derivative + 1) @ weights
    scale = np.abs(m.shape(x, derivative)).max()
    np.testing.assert_allclose(integral, gained[:, 0], atol=1e-12 * scale)


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_ends_are_in_balance(boundary):
    rig = preset("bossi2009")
    m = modes(rig, 6, boundary)
    EI, w2 = rig["bending_stiffness"], m.frequencies**2
    (w0, w), (d0, d), (dd0, dd), (_, ddd) = (m.shape([0, rig["length"]], k).T for k in range(4))
    scale = EI * np.abs(m.shape(np.linspace(0, rig["length"], 99), 2)).max(axis=1)
    assert np.all(np.abs(w0) < 1e-12)
    hub = -rig["hub_inertia"] * w2 * d0 if boundary == "free" else EI * dd0
    np.testing.assert_allclose((EI * dd0 - hub) / scale, 0, atol=1e-12)
    np.testing.assert_allclose((EI * dd - rig["tip_inertia"] * w2 * d) / scale, 0, atol=1e-12)
    shear = (EI * ddd + rig["tip_mass"] * w2 * w) * rig["length"]
    np.testing.assert_allclose(shear / scale, 0, atol=1e-11)
    if boundary == "clamped":
        np.testing.assert_allclose(d0, 0, atol=1e-12)


def test_free_modes_have_no_angular_momentum_about_the_hub():
    # Orthogonal to the rigid rotation w = x, which is what makes the frame pseudo-pinned.
    rig = preset("bossi2009")
    m = modes(rig, 6)
    x, weights = quadrature(rig["length"])
    momentum = rig["linear_density"] * m.shape(x) @ (weights * x)
    momentum += rig["tip_mass"] * rig["length"] * m.shape(rig["length"])[:, 0]
    momentum += rig["tip_inertia"] * m.shape(rig["length"], 1)[:, 0]
    momentum += rig["hub_inertia"] * m.shape(0.0, 1)[:, 0]
    np.testing.assert_allclose(momentum, 0, atol=1e-12)


@pytest.mark.parametrize("ratios", RATIOS, ids=str)
def test_free_and_clamped_frequencies_interlace(ratios):
    # Locking the hub is one constraint (Rayleigh); a heavy hub brings them together, hence the rounding.
    free, clamped = (modes(loaded(*ratios), 10, b).frequencies for b in BOUNDARIES)
    assert np.all(clamped <= free * (1 + 1e-12))
    assert np.all(free[:-1] <= clamped[1:] * (1 + 1e-12))


def test_heavy_payload_swings_on_the_static_spring():
    rig = loaded(0, 1e8, 0)
    frequency = modes(rig, 1, "clamped").frequencies[0]
    spring = 1 / np.sqrt(static_tip_compliance(rig) * rig["tip_mass"])
    np.testing.assert_allclose(frequency, spring, rtol=1e-8)  # the link adds 33/140 of its mass: 1e-9


def test_inertias_at_both_ends_swing_against_each_other():
    # A massless link, w = x^3/6 - x l^2/2: spring 3 EI/l between J0 and mp l^2.
    rig = loaded(1e8, 1e8, 0)
    seen = 1 / (1 / rig["hub_inertia"] + 1 / (rig["tip_mass"] * rig["length"] ** 2))
    spring = 3 * rig["bending_stiffness"] / rig["length"]
    np.testing.assert_allclose(modes(rig, 1).frequencies[0], np.sqrt(spring / seen), rtol=1e-8)


def test_signs_are_as_documented():
    rig = preset("bossi2009")
    assert np.all(modes(rig, 12).shape(0.0, 1) > 0)
    clamped = modes(rig, 12, "clamped")
    assert np.all(clamped.shape(0.0, 2) > 0)
    assert clamped.shape(rig["length"])[0, 0] > 0


def test_shapes_continue_across_the_change_of_basis():
    # At b = 2, reached for this hub and payload, the shape is written in other functions.
    def first(mass):
        return modes(loaded(0.5, mass, 0.01), 1)

    mass = brentq(lambda value: first(value).roots[0] - 2, 0.01, 1.0, xtol=1e-15)
    below, above = first(mass * (1 + 1e-9)), first(mass * (1 - 1e-9))
    assert below.roots[0] < 2 < above.roots[0]
    x = np.linspace(0, BARE["length"], 9)
    for derivative in range(4):
        np.testing.assert_allclose(below.shape(x, derivative), above.shape(x, derivative), atol=1e-6)


def test_rigid_inertia_is_the_published_sum():
    rig = preset("bossi2009-printed")
    assert rigid_inertia(rig) == pytest.approx(0.0016 + 0.09 * 0.42**3 / 3 + 0.155 * 0.42**2 + 1.73e-5)


def test_six_modes_are_quick():
    rig = preset("bossi2009")
    modes(rig, 6)
    took = []
    for _ in range(20):
        start = time.perf_counter()
        modes(rig, 6)
        took.append(time.perf_counter() - start)
    assert min(took) < 5e-3  # 0.5 ms on a quiet machine; fits call it hundreds of times


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((BARE, 0), "number of modes is 0"),
        ((BARE, 2, "pinned"), "Unsupported boundary: 'pinned'"),
        (({**BARE, "length": 0.0}, 2), "length is 0; expected a positive number"),
        (({**BARE, "tip_mass": -1.0}, 2), "tip_mass is -1; expected 0 or a positive number"),
        (({**BARE, "tip_inertia": np.nan}, 2), "tip_inertia is nan"),
    ],
)
def test_impossible_input_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        modes(*arguments)


def test_position_off_the_link_is_refused():
    with pytest.raises(ValueError, match="off the link; expected 0 to 0.7 m"):
        modes(BARE, 2).shape(0.8)
