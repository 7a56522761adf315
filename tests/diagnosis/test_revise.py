"""The backward look: first picks that later ones make needless, or that stood in for another effect."""

from dataclasses import replace

import pytest
from rig_campaigns import planned_fit

from twin.diagnosis import candidates
from twin.diagnosis.revise import revise
from twin.diagnosis.state import Round, SearchState
from twin.estimation.calibrate import calibrate
from twin.estimation.residual_pool import ResidualPool

pytestmark = pytest.mark.slow

MISSING = {"viscous-friction": {"viscous": 0.003}, "torque-bias": {"bias": 0.004}}


@pytest.fixture(scope="module")
def start(rig_campaign):
    """The calibrated model of a rig with a viscous friction and a torque bias that nobody declared."""
    campaign = rig_campaign(MISSING, 11, experiments=planned_fit(11, "bang-bang")).read()
    with ResidualPool(1) as pool:
        yield calibrate(campaign, pool)


def picked(start, *names):
    """What a search would have come to that adopted these effects, one after the other."""
    before, adopted = start.base, []
    for name in names:
        adopted.append(candidates.try_effect(start.bench, before, name))
        before = adopted[-1].fit
    rounds = (Round((c,), threshold=30.0, adopted=c, bench=start.bench) for c in adopted)
    return SearchState(start, tuple(rounds))


def names(found):
    return [c.effects[-1] for c in found.adopted]


def test_a_first_pick_that_a_later_one_makes_needless_is_dropped(start):
    found = revise(picked(start, "air-pad-drag", "viscous-friction"))
    assert names(found) == ["viscous-friction"]
    assert list(found.best.model.effects) == ["viscous-friction"]
    assert found.best.model.effects["viscous-friction"]["viscous"] == pytest.approx(0.003, rel=0.05)
    [only] = found.rounds
    assert only.ranked[0] is only.adopted
    [(name, judgement)] = found.withdrawn
    assert (name, judgement.rule, judgement.passed) == ("air-pad-drag", "needed-beside-later", False)


def test_two_that_are_both_missing_stay(start):
    found = picked(start, "viscous-friction", "torque-bias")
    assert revise(found) is found


def test_a_close_loser_that_explains_more_beside_the_second_takes_its_place(start):
    found = picked(start, "air-pad-drag", "torque-bias")
    loser = candidates.try_effect(start.bench, start.base, "viscous-friction")
    close = replace(loser, score=found.adopted[0].score - 1)
    first, second = found.rounds
    found = revise(replace(found, rounds=(replace(first, ranked=(first.adopted, close)), second)))
    assert sorted(names(found)) == ["torque-bias", "viscous-friction"]
    assert found.best.cost < picked(start, "air-pad-drag", "torque-bias").best.cost - 30


def test_one_effect_is_not_looked_back_at(start):
    found = picked(start, "viscous-friction")
    assert revise(found) is found
