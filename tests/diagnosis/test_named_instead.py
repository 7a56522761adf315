"""Whether an effect replaces a smooth function that is significant while no score exceeds the limits."""

from types import SimpleNamespace

import pytest

from twin.diagnosis import candidates, contest, notes, remainder, rules
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.revise import replace_function_by_effect
from twin.diagnosis.state import Round, SearchState

BY_CHANCE, PENALTY = 12.0, 9.0


def explored(monkeypatch, score, evidence, elsewhere=8.0, fine=None, large=(), adopted=0):
    """A search whose last round adopted nothing: its best score, and the evidence of a function."""
    base = SimpleNamespace(model=SimpleNamespace(effects={}))
    fit = SimpleNamespace(model=SimpleNamespace(effects={"cogging": {}}))
    bench = SimpleNamespace(penalty=lambda count: PENALTY * count / 2)
    candidate = Candidate(("cogging",), fit, score)
    law = SimpleNamespace(variable="hub_angle")
    smooth = SimpleNamespace(evidence=evidence, law=law) if evidence else None
    monkeypatch.setattr(remainder, "significant_function", lambda _: smooth)
    monkeypatch.setattr(remainder, "large_residuals", lambda _: large)
    monkeypatch.setattr(rules, "gain_elsewhere", lambda *_: elsewhere)
    monkeypatch.setattr(contest, "fit_to_convergence", lambda bench, base, ranked: list(ranked))
    monkeypatch.setattr(contest, "refit_in_fine_limit", lambda bench, found: (bench, found))
    monkeypatch.setattr(contest, "refit_with_own_noise", lambda bench, base, found: (bench, found))
    monkeypatch.setattr(candidates, "score_gain", lambda *_: score if fine is None else fine)
    taken = {"adopted": candidate, "bench": bench} if adopted else {}
    start = SimpleNamespace(base=base, bench=bench, declared=SimpleNamespace(effects={}))
    return SearchState(start, (Round((candidate,), BY_CHANCE, 30.0, **taken),))


@pytest.mark.parametrize(("score", "evidence"), [(17.4, 21.7), (25.7, 31.1), (28.0, 8.0), (12.5, 5.1)])
def test_an_effect_that_explains_as_much_as_a_function_has_its_place(monkeypatch, score, evidence):
    found = replace_function_by_effect(explored(monkeypatch, score, evidence))
    assert found.names == ["cogging"]
    assert found.rounds[0].threshold == max(evidence - PENALTY, BY_CHANCE)
    [said] = notes._adopted_instead(found)
    assert f"cogging gains {score:.0f}, less than 30" in said
    assert f"the hub angle makes the recordings e^{evidence:.0f} times likelier" in said
    assert found.rounds[0].ranked[0].score == found.adopted[0].score == score


@pytest.mark.parametrize(
    "case",
    [
        # Nothing is left that has no name.
        {"score": 28.0, "evidence": None},
        # The function explains far more: a friction that gets less as it warms, and one that depends on the angle.
        {"score": 23.0, "evidence": 89.0},
        # Chance gives as much.
        {"score": 11.0, "evidence": 12.0},
        # It is one recording that gains.
        {"score": 17.4, "evidence": 21.7, "elsewhere": -1.0},
        # What a coarse chain made of it.
        {"score": 17.4, "evidence": 21.7, "fine": 2.0},
        # More is left than a function of small values.
        {"score": 17.4, "evidence": 21.7, "large": ("hub_torque",)},
        # Nobody asked for one effect more.
        {"score": 400.0, "evidence": 21.7, "adopted": 1},
    ],
)
def test_else_the_function_stays_without_a_name(monkeypatch, case):
    found = explored(monkeypatch, **case)
    assert replace_function_by_effect(found) is None
    assert notes._adopted_instead(found) == []
