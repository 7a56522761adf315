"""Whether an effect or a function without a name is behind what is too small for either by its size."""

from types import SimpleNamespace

import pytest

from twin.diagnosis import notes, rather_named
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.state import SearchState

BY_CHANCE, PRICE = 12.0, 9.0


def explored(monkeypatch, score, evidence, elsewhere=8.0, fine=None, large=(), adopted=0):
    """A search whose last round adopted nothing: its best score, and the evidence of a function."""
    base = SimpleNamespace(model=SimpleNamespace(effects={}))
    fit = SimpleNamespace(model=SimpleNamespace(effects={"cogging": {}}))
    bench = SimpleNamespace()
    candidate = Candidate(("cogging",), fit, score)
    law = SimpleNamespace(variable="hub_angle")
    smooth = SimpleNamespace(evidence=evidence, law=law) if evidence else None
    monkeypatch.setattr(rather_named.verdict, "nameless", lambda _: smooth)
    monkeypatch.setattr(rather_named.verdict, "too_large", lambda _: large)
    monkeypatch.setattr(rather_named.verdict, "elsewhere", lambda *_: elsewhere)
    monkeypatch.setattr(rather_named.contenders, "settled", lambda bench, base, ranked: list(ranked))
    monkeypatch.setattr(rather_named.contenders, "on_fine_chain", lambda bench, found: found)
    monkeypatch.setattr(rather_named.contenders, "seen_anew", lambda bench, base, found: (bench, found))
    monkeypatch.setattr(rather_named.search, "gain", lambda *_: score if fine is None else fine)
    monkeypatch.setattr(rather_named.search, "price", lambda count, bench: PRICE * count / 2)
    rounds = ((candidate,),) if adopted == 0 else ((candidate,),) * adopted
    start = SimpleNamespace(base=base, declared=SimpleNamespace(effects={}))
    return SearchState(start, (candidate,) * adopted, rounds, (30.0,), (bench,) * (adopted + 1), (BY_CHANCE,))


@pytest.mark.parametrize(("score", "evidence"), [(17.4, 21.7), (25.7, 31.1), (28.0, 8.0), (12.5, 5.1)])
def test_an_effect_that_explains_as_much_as_a_function_has_its_place(monkeypatch, score, evidence):
    found = rather_named.named_instead(explored(monkeypatch, score, evidence))
    assert found.names == ["cogging"]
    assert found.thresholds == (max(evidence - PRICE, BY_CHANCE),)
    assert len(found.benches) == 2
    [said] = notes._instead(found)
    assert f"cogging gains {score:.0f}, less than 30" in said
    assert f"the hub angle makes the recordings e^{evidence:.0f} times likelier" in said
    assert found.rounds[0][0].score == found.adopted[0].score == score


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
    assert rather_named.named_instead(found) is None
    assert notes._instead(found) == []
