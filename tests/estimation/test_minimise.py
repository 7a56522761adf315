"""The optimiser of the fits, on a residual whose least cost is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from twin.estimation.minimise import minimise, with_own_jacobian
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.slopes import difference_jacobian
from twin.estimation.unknowns import Unknown
from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.residuals.groups import Group
from twin.rigs import preset
from twin.rigs.model import Model

TRUE = 0.1  # N m^2, far from where the fit starts
ROWS = 100


class Curved:
    """One recording whose residual bends: of 60 noise levels where the fit starts, none at the true stiffness."""

    prepared = (SimpleNamespace(channels=("strain_base",), recording=SimpleNamespace(duration=1.0)),)
    groups = blocks = (Group(0, "strain_base", slice(0, ROWS)),)
    weight = np.ones(ROWS)

    def counts(self):
        return np.array([float(ROWS)])

    def residual(self, model, i, start):
        off = np.log(model.rig["bending_stiffness"] / TRUE)
        return {"strain_base": 60.0 * np.tanh(off) * np.ones(ROWS)}


def declared_model():
    rig = preset("bossi2009")
    return Model(rig, {}, chain.fit_shape(rig, 3), {}, 1e-3)


def fitted(goal):
    """The fit, and the costs of its iterations."""
    model, told = declared_model(), []
    unknown = Unknown("rig", "bending_stiffness", 0.25, 1e-3, False, (0.01, 1.0))
    with ResidualPool(1) as pool:
        bench = Workbench(Curved(), pool)
        found = minimise(bench, model, (Start(),), (unknown,), iterations=12, report=told.append, goal=goal)
    return found, told


def test_the_least_cost_is_found():
    found, _ = fitted(np.inf)
    assert found.model.rig["bending_stiffness"] == pytest.approx(TRUE, rel=1e-3)


def test_what_may_still_come_to_its_goal_goes_on_to_the_end():
    found, told = fitted(np.inf)
    again, as_long = fitted(found.cost + 1.0)
    assert again.cost == found.cost
    assert as_long == told


def test_what_will_not_come_to_its_goal_is_given_up():
    _, told = fitted(-1e6)
    assert len(told) == 1


class Rounded(Curved):
    """The same residual, in which the initial angle of the hub shows by rounding alone."""

    def residual(self, model, i, start):
        found = super().residual(model, i, start)
        return {"strain_base": found["strain_base"] + 1e-12 * np.sin(1e3 * start.hub_angle)}


def test_what_shows_by_rounding_alone_has_no_slope():
    model, start = declared_model(), Start()
    rig = model.declared
    unknowns = [
        Unknown("rig", "bending_stiffness", rig["bending_stiffness"], 0.01, True, (1e-3, 1.0)),
        Unknown("start", "hub_angle", 0.0, 1e-3, False, (-10.0, 10.0), recording=0),
    ]
    x = np.array([u.start for u in unknowns])
    with ResidualPool(1) as pool:
        bench = Workbench(Rounded(), pool)
        (r,) = bench.residuals([(model, (start,), None)])
        J, _ = difference_jacobian(bench, model, (start,), unknowns, x, r, np.array([1e-3, 1e-3]), {})
    assert np.all(J[:, 0] != 0)
    assert not J[:, 1].any()


class Ratio(Curved):
    """A residual that tells stiffness over density to 3 parts in a million, and nothing of their common factor."""

    def residual(self, model, i, start):
        declared = preset("bossi2009")
        stiffness, density = (
            np.log(model.rig[n] / declared[n]) for n in ("bending_stiffness", "linear_density")
        )
        return {"strain_base": 3e4 * np.expm1(stiffness - density) * np.ones(ROWS)}


def along_the_valley(highest_density):
    """The fit of stiffness (declared to 2 %) and density (to 1 %), begun with both 6 % too high."""
    model = declared_model()
    stiffness, density = (model.declared[n] for n in ("bending_stiffness", "linear_density"))
    unknowns = (
        Unknown(
            "rig", "bending_stiffness", stiffness, 0.02 * stiffness, True, (0.1 * stiffness, 10 * stiffness)
        ),
        Unknown(
            "rig", "linear_density", density, 0.01 * density, True, (0.1 * density, highest_density * density)
        ),
    )
    x = np.array([1.06 * stiffness, 1.06 * density])
    with ResidualPool(1) as pool:
        bench = Workbench(Ratio(), pool)
        found = minimise(bench, model, (Start(),), unknowns, x)
        return found.values / (stiffness, density), with_own_jacobian(bench, found)


def test_priors_decide_where_the_data_leave_a_direction_to_them():
    found, _ = along_the_valley(10.0)
    assert found == pytest.approx([1.0, 1.0], abs=1e-4)


def test_a_bound_stops_one_unknown_and_not_the_others():
    found, _ = along_the_valley(0.99)
    assert found == pytest.approx([0.99, 0.99], abs=1e-4)


def test_errors_along_such_a_direction_are_those_of_the_priors():
    _, own = along_the_valley(10.0)
    both = (1 / 0.02**2 + 1 / 0.01**2) ** -0.5
    assert own.errors / own.values == pytest.approx([both, both], rel=0.01)


def test_what_shows_by_rounding_alone_stays_where_it_is():
    unknowns = (
        Unknown("rig", "bending_stiffness", 0.25, 1e-3, False, (0.01, 1.0)),
        Unknown("start", "hub_angle", 0.0, 1e-3, False, (-np.inf, np.inf), recording=0),
    )
    with ResidualPool(1) as pool:
        found = minimise(Workbench(Rounded(), pool), declared_model(), (Start(),), unknowns, iterations=12)
    assert found.values == pytest.approx([TRUE, 0.0], rel=1e-3)
