"""Which of some candidates that explain about as much is put first."""

from types import SimpleNamespace

import pytest

from twin.diagnosis.contest import prefer_simpler


def candidate(score, unknowns):
    return SimpleNamespace(score=score, fit=SimpleNamespace(unknowns=range(unknowns)))


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
