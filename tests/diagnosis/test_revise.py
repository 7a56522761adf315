"""The backward look: first picks that later ones make needless, or that stood in for another effect."""

from dataclasses import replace

import pytest
from rig_campaigns import planned_fit

from twin.diagnosis import candidates, diagnose
from twin.diagnosis.judgement import Judgement
from twin.diagnosis.revise import rebuild, revise
from twin.diagnosis.state import Round, SearchState
from twin.estimation.calibrate import calibrate
from twin.estimation.minimise import minimise
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.workbench import Workbench
from twin.residuals.data import DrivenData

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


def test_what_is_left_is_scored_on_the_data_of_its_own_round(start):
    """A search may go on with other data, whose costs are not comparable."""
    first, second = picked(start, "air-pad-drag", "viscous-friction").rounds
    loud = [replace(p, noise={c: 3 * v for c, v in p.noise.items()}) for p in start.bench.prepared]
    bench = Workbench(DrivenData.of(loud, start.base.model), start.bench.pool)
    fit = minimise(bench, second.adopted.fit.model, start.base.starts, second.adopted.fit.unknowns)
    after = replace(second, adopted=replace(second.adopted, fit=fit), bench=bench)
    state = SearchState(start, (first, after))
    [quiet] = rebuild(state, ["air-pad-drag"], fit).rounds
    assert quiet.adopted.score == pytest.approx(first.adopted.score, rel=0.2)
    [kept] = rebuild(state, ["viscous-friction"], fit).rounds
    alone = candidates.try_effect(start.bench, start.base, "viscous-friction")
    assert kept.adopted.score == pytest.approx(alone.score, rel=0.2)


def test_other_candidates_keep_their_distance_where_the_effects_before_them_are_withdrawn(start):
    """Their scores are beside those effects: compared with the score of the adopted one alone, they may exceed it."""
    first, second = picked(start, "air-pad-drag", "viscous-friction").rounds
    beside = replace(second.adopted, score=200.0)
    behind = replace(beside, effects=("air-pad-drag", "torque-bias"), score=160.0)
    state = SearchState(start, (first, replace(second, ranked=(beside, behind), adopted=beside)))
    alone = minimise(start.bench, beside.fit.model, start.base.starts, beside.fit.unknowns)
    [kept] = rebuild(state, ["viscous-friction"], alone).rounds
    assert kept.adopted.score < 160
    assert [c.effects[-1] for c in kept.ranked] == ["viscous-friction", "torque-bias"]
    assert kept.ranked[1].score == pytest.approx(kept.adopted.score - 40)


def test_what_was_withdrawn_for_its_size_is_no_candidate_again(start, monkeypatch):
    """What was withdrawn for another reason is one."""
    explored = []
    monkeypatch.setattr(
        candidates,
        "explore",
        lambda bench, base, names, progress: explored.extend(names) or candidates.Exploration([], {}),
    )
    untold = Judgement("size-is-determined", 0.5, 3.0, False)
    needless = Judgement("needed-beside-later", 1.0, 30.0, False)
    state = SearchState(start, withdrawn=(("backlash", untold), ("torque-bias", needless)))
    assert state.undetermined == ["backlash"]
    diagnose.next_round(state, lambda message: None, 0.01)
    assert "torque-bias" in explored
    assert "dead-zone" in explored
    assert "backlash" not in explored


def test_the_search_goes_on_without_what_was_withdrawn_for_its_size(start, monkeypatch):
    untold = Judgement("size-is-determined", 0.5, 3.0, False)
    found = picked(start, "air-pad-drag", "viscous-friction")
    searched = []
    monkeypatch.setattr(
        diagnose.revise,
        "without_undetermined",
        lambda state: state.with_adoptions(state.rounds[:1], {"viscous-friction": untold}),
    )
    monkeypatch.setattr(
        diagnose, "_searched_to_end", lambda state, more, *_: searched.append((state, more)) or state
    )
    diagnose._final_state(found, found.bench, lambda message: None, 0.01)
    [(state, more)] = searched
    assert more
    assert (state.names, state.undetermined) == (["air-pad-drag"], ["viscous-friction"])


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


@pytest.mark.parametrize(("rule", "takes"), [("best-of-round", True), ("gains-elsewhere", False)])
def test_what_its_round_turned_down_takes_no_place(start, rule, takes):
    found = picked(start, "air-pad-drag", "torque-bias")
    loser = candidates.try_effect(start.bench, start.base, "viscous-friction")
    close = replace(loser, score=found.adopted[0].score - 1)
    first, second = found.rounds
    judged = {"viscous-friction": (Judgement(rule, 2.0, 1.0, False),)}
    first = replace(first, ranked=(first.adopted, close), judgements=judged)
    revised = revise(replace(found, rounds=(first, second)))
    assert ("viscous-friction" in names(revised)) == takes


def test_one_effect_is_not_looked_back_at(start):
    found = picked(start, "viscous-friction")
    assert revise(found) is found
