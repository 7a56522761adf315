"""Two effects that add up to something else, and orders that are whole numbers."""

import numpy as np
import pytest
from rig_campaigns import planned

from twin.diagnosis import candidates, contest, revise
from twin.diagnosis.conclude import explanatory_variables, verdict_of
from twin.diagnosis.dependence import unexplained_residuals
from twin.diagnosis.diagnose import with_errors, with_unnamed, with_whole_orders
from twin.diagnosis.state import Round, SearchState
from twin.estimation.calibrate import calibrate
from twin.estimation.residual_pool import ResidualPool

pytestmark = pytest.mark.slow

SPRING = {"cable-torsion": {"stiffness": 0.01, "rest_angle": 0.3}}
COGGING = {"cogging": {"amplitude": 0.01, "order": 5.0, "phase": 0.9}}


@pytest.fixture(scope="module")
def picked(rig_campaign):
    """A function of what is missing: what a search comes to that adopts a cable and then a cogging."""
    pool = ResidualPool(1)

    def of(effects):
        slews = planned(12, "bang-bang", "random-steps")
        start = calibrate(rig_campaign(effects, 12, experiments=slews).read(), pool)
        cable = candidates.try_effect(start.bench, start.base, "cable-torsion")
        both = candidates.try_effect(start.bench, cable.fit, "cogging")
        both = contest.fit_fully(start.bench, cable.fit, both, both.fit.values)
        rounds = (Round((c,), 0.0, 30.0, np.zeros(400), {}, c, start.bench) for c in (cable, both))
        return with_errors(SearchState(start, tuple(rounds)), start.bench)

    yield of
    pool.shutdown()


@pytest.mark.study
def test_a_cable_that_gets_stiffer_is_no_cable_with_cogging(picked):
    found = picked({"hardening-cable": {"stiffness": 0.1}})
    assert verdict_of(found) == "explained"
    other = revise.without_undetermined(found)
    assert other is not None
    assert not other.adopted
    assert [(name, j.rule) for name, j in other.withdrawn] == [
        ("cable-torsion", "size-is-determined"),
        ("cogging", "size-is-determined"),
    ]
    other = with_unnamed(other, other.bench, 0.01)
    assert verdict_of(other) == "outside-library"
    assert explanatory_variables(other, unexplained_residuals(other.bench, other.best))[0] == "hub_angle"


@pytest.mark.study
def test_two_that_are_both_missing_are_told_and_a_whole_order_is_taken(picked):
    found = picked(SPRING | COGGING)
    assert revise.without_undetermined(found) is None
    whole = with_whole_orders(found, found.bench)
    assert whole.best.model.effects["cogging"]["order"] == 5.0
    assert not any(u.name == "order" for u in whole.best.unknowns)
    for name, effect in (SPRING | COGGING).items():
        for u, value, error in zip(whole.best.unknowns, whole.best.values, whole.best.errors, strict=True):
            if u.effect == name:
                assert value == pytest.approx(effect[u.name], abs=4 * error + 0.02 * abs(effect[u.name]))


@pytest.mark.study
def test_an_order_between_two_whole_numbers_stays(picked):
    found = picked(SPRING | {"cogging": {"amplitude": 0.03, "order": 5.4, "phase": 0.9}})
    assert revise.with_whole_orders(found.bench, found.best) is found.best
    assert found.best.model.effects["cogging"]["order"] == pytest.approx(5.4, abs=0.15)
