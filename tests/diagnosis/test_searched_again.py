"""Of a search on driven data and one on output errors, the answer that explains more is taken."""

from types import SimpleNamespace

import pytest

from twin.diagnosis import diagnose, remainder
from twin.recording import HUB_TORQUE


def searched(adopted, unexplained, on_output_errors):
    return SimpleNamespace(
        start=None,
        adopting=adopted,
        adopted=adopted,
        unexplained=unexplained,
        on_output_errors=on_output_errors,
    )


@pytest.mark.parametrize(
    ("first", "second", "second_is_taken"),
    [
        # It explains all.
        ((["cogging"], [HUB_TORQUE]), (["cogging", "backlash"], []), True),
        (([], [HUB_TORQUE]), (["backlash"], []), True),
        # It explains a part where the first explained nothing.
        (([], [HUB_TORQUE]), (["viscous-friction"], [HUB_TORQUE]), True),
        # It explains no more.
        (([], [HUB_TORQUE]), ([], [HUB_TORQUE]), False),
        ((["cogging"], [HUB_TORQUE]), (["cogging", "backlash"], [HUB_TORQUE]), False),
        # It was not asked for.
        ((["cogging"], []), (["backlash"], []), False),
    ],
)
def test_the_search_that_explains_more_is_taken(monkeypatch, first, second, second_is_taken):
    driven, free = searched(*first, False), searched(*second, True)
    monkeypatch.setattr(diagnose, "first_round", lambda *_: (driven, False))
    monkeypatch.setattr(diagnose, "continued_on_output_errors", lambda state, more, _: (state, more))
    monkeypatch.setattr(diagnose, "SearchState", lambda *_: free)
    monkeypatch.setattr(diagnose, "on_output_errors", lambda state, more, _: (free, more))
    monkeypatch.setattr(diagnose, "_searched_to_end", lambda state, *_: state)
    monkeypatch.setattr(remainder, "unexplained_channels", lambda state: tuple(state.unexplained))
    found = diagnose.search(None, None)
    assert found is (free if second_is_taken else driven)
