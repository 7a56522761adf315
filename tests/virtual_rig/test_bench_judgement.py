"""Judgement of the benchmark on virtual benches: what counts as right, and which sizes hold the truth."""

import benches
import pytest


def answer(kind, effects, verdict, adopted, errors=()):
    return {
        "verdict": verdict,
        "adopted": {name: [values, dict.fromkeys(values, 0.01)] for name, values in adopted.items()},
        "ranking": list(adopted),
        "errors": list(errors),
        "truth": {"kind": kind, "effects": effects},
        "seconds": 60.0,
    }


VISCOUS = {"viscous-friction": {"viscous": 0.06}}
BACKLASH = {"backlash": {"gap": 0.02}}
STOP = {"hard-stop": {"angle": 0.4}}


@pytest.mark.parametrize(
    ("right", "kind", "effects", "verdict", "adopted"),
    [
        (True, "back-emf", VISCOUS, "explained", VISCOUS),
        (False, "back-emf", VISCOUS, "explained", VISCOUS | BACKLASH),
        (False, "back-emf", VISCOUS, "outside-library", VISCOUS),
        (True, "pair", VISCOUS | BACKLASH, "explained", BACKLASH | VISCOUS),
        (False, "pair", VISCOUS | BACKLASH, "explained", VISCOUS),
        (True, "nothing", {}, "no-missing-effect", {}),
        (False, "nothing", {}, "explained", VISCOUS),
        (False, "nothing", {}, benches.REFUSED, {}),
        (True, "outside", VISCOUS | STOP, "outside-library", VISCOUS),
        (False, "outside", VISCOUS | STOP, "explained", VISCOUS),
    ],
)
def test_right_is_all_that_is_missing_and_nothing_else(right, kind, effects, verdict, adopted):
    assert benches.is_right(answer(kind, effects, verdict, adopted)) == right


@pytest.mark.parametrize(("found", "holds"), [(0.085, True), (0.1, False)])
def test_sizes_are_held_to_three_standard_errors(found, holds):
    told = answer("back-emf", VISCOUS, "explained", {"viscous-friction": {"viscous": found}})
    assert benches.sizes_within(told, ["viscous-friction"]) == [holds]


def test_phases_repeat_after_a_turn():
    ripple = {"position-dependent-friction": {"phase": 3.13}}
    told = answer("other", ripple, "explained", {"position-dependent-friction": {"phase": -3.14}})
    assert benches.sizes_within(told, ["position-dependent-friction"]) == [True]


def test_the_table_has_a_row_for_each_kind_and_effect():
    errors = [{"after": 2.0, "reach": 1.0, "windows": 1.5}]
    rows = benches.table(
        [
            answer("pair", VISCOUS | BACKLASH, "explained", VISCOUS, errors),
            answer("nothing", {}, "no-missing-effect", {}, errors),
        ]
    ).splitlines()
    assert "| pair | 1 | 0 | 1 | 0 | 0 | 1 of 1 | 2.00 | 1.50 | 60 s |" in rows
    assert "| nothing | 1 | 1 | 0 | 0 | 0 | - | 2.00 | 1.50 | 60 s |" in rows
    assert "| backlash | 1 | 0 | 0 | - |" in rows
    assert any("viscous-friction+backlash -> viscous-friction, explained (1)" in row for row in rows)
