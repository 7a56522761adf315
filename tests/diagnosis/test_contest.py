"""Which of some candidates that explain about as much is put first."""

from types import SimpleNamespace

import numpy as np
import pytest

from twin.diagnosis import contest
from twin.diagnosis.candidates import CONTENDERS
from twin.diagnosis.contest import fit_to_convergence, prefer_simpler


def candidate(score, unknowns, name="cogging", rows=0):
    fit = SimpleNamespace(unknowns=range(unknowns), jacobian=np.zeros((rows, unknowns)), cost=-score)
    return SimpleNamespace(score=score, name=name, fit=fit)


@pytest.mark.parametrize(
    ("fewer", "behind", "simple"),
    [(1, 15.0, True), (1, 25.0, False), (3, 50.0, True), (3, 70.0, False), (-1, 5.0, False)],
)
def test_every_parameter_more_has_to_gain_two_percent(fewer, behind, simple):
    best, other = candidate(1000.0, 13), candidate(1000.0 - behind, 13 - fewer)
    assert prefer_simpler([other, best])[0] is (other if simple else best)


def test_among_equals_the_better_one_is_first():
    ranked = [candidate(s, 12) for s in (300.0, 299.0, 298.0)]
    assert [c.score for c in prefer_simpler(ranked[::-1])] == [300.0, 299.0, 298.0]


def test_the_first_candidate_has_a_jacobian_also_where_it_was_no_contender(monkeypatch):
    def fitted(bench, base, found, *_):
        return candidate(found.score, len(found.fit.unknowns), found.name, rows=3)

    monkeypatch.setattr(contest, "fit_fully", fitted)
    stored = [candidate(300.0 - k / 4, 13) for k in range(CONTENDERS)] + [candidate(299.0, 12, "air-drag")]
    first, *others = fit_to_convergence(None, None, stored)
    assert first.name == "air-drag"
    assert len(first.fit.jacobian) == 3
    assert len(others) == CONTENDERS
