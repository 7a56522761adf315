"""What counts as a change between two answers of one rig."""

import math
from types import SimpleNamespace

import fleet_tasks
import pytest

from twin.files.provenance import Provenance
from twin.fleet.changes import changes
from twin.fleet.stored import StoredAnswer

TASK = SimpleNamespace(
    campaign=SimpleNamespace(name="a"),
    record=Provenance("0", "2026-01-01", None, {}, {}),
    false_alarm_rate=0.01,
)


def answer(**changes) -> StoredAnswer:
    return StoredAnswer.model_validate(fleet_tasks.answer(TASK, **changes))


def effect(name: str, **values: tuple[float | None, float | None]) -> dict:
    parameters, errors = ({p: v[k] for p, v in values.items()} for k in (0, 1))
    return {"name": name, "probability": 0.9, "parameters": parameters, "standard_errors": errors}


def texts(before: dict, after: dict) -> list[str]:
    return [c.text for c in changes(answer(**before), answer(**after))]


def test_nothing_changed():
    assert texts({}, {}) == []


@pytest.mark.parametrize(
    ("value", "said"),
    # The errors of both are 1e-4: that of the difference is 1.41e-4.
    [(0.0124, []), (0.0125, ["cable torsion: stiffness 0.01200 → 0.01250 N·m/rad (3.5 σ)"])],
)
def test_a_parameter_moves_beyond_three_standard_errors_of_the_difference(value, said):
    assert texts({}, {"effects": (effect("cable-torsion", stiffness=(value, 1e-4)),)}) == said


def test_new_and_gone_effects_are_named():
    other = {"effects": (effect("backlash"),)}
    assert texts({}, other) == ["backlash is new", "cable torsion is gone"]


def test_a_phase_repeats_after_a_turn():
    def at(phase: float) -> dict:
        return {"effects": (effect("position-dependent-friction", phase=(phase, 0.01)),)}

    assert texts(at(0.1), at(0.1 + 2 * math.pi)) == []
    assert len(texts(at(0.1), at(0.3))) == 1


@pytest.mark.parametrize("unknown", [(None, 1e-4), (0.02, None), (0.02, 0.0)])
def test_without_a_standard_error_nothing_is_said_of_a_parameter(unknown):
    before, after = (
        {"effects": (effect("cable-torsion", stiffness=value),)} for value in (unknown, (0.03, 0.0))
    )
    assert texts(before, after) == []


def test_an_effect_of_another_package_has_no_unit():
    before, after = ({"effects": (effect("of-my-own", size=(v, 0.1)),)} for v in (1.0, 2.0))
    assert texts(before, after) == ["of my own: size 1.000 → 2.000 (7.1 σ)"]
