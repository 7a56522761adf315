"""Held-out recordings withdraw a verdict where most of their windows are off, and not for a stick or slip more."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from twin.diagnosis.contradiction import contradictions, in_words
from twin.diagnosis.error_budget import ChannelBudget, ModelError

NOISE = 1e-3
QUIET = (1.0, 1.1, 0.9, 1.0)


def error(levels):
    """The error in windows that are off by these noise levels."""
    return ModelError(NOISE * max(levels, default=0.0), by_window=tuple(NOISE * level for level in levels))


def fitted(levels=QUIET):
    return SimpleNamespace(role="fit", budget={}, windows={"hub_angle": error(levels)})


def held_out(after, calibrated=(50.0,) * 4, before=(50.0,) * 4):
    budget = ChannelBudget(
        unit="rad",
        noise=NOISE,
        before=error(before),
        calibrated=error(calibrated),
        steps=(),
        after=error(after),
    )
    return SimpleNamespace(role="holdout", budget={"hub_angle": budget}, windows={})


def test_held_out_windows_at_the_noise_contradict_nothing():
    assert contradictions({"a.csv": fitted(), "b.csv": held_out(QUIET)}, True) == ()


def test_one_window_with_a_stick_more_contradicts_nothing():
    assert contradictions({"a.csv": fitted(), "b.csv": held_out((1.0, 400.0, 1.0, 1.0))}, True) == ()


def test_errors_in_most_windows_contradict_and_say_where():
    [found] = contradictions({"a.csv": fitted(), "b.csv": held_out((8.0, 9.0, 1.0, 10.0))}, True)
    assert (found.recording, found.channel, found.reference) == ("b.csv", "hub_angle", "fit")
    assert found.size == pytest.approx((8.5**2 - 2.5**2) ** 0.5)
    assert "b.csv" in in_words(found, "the hub angle")
    assert "8.12 noise levels" in in_words(found, "the hub angle")


def test_where_the_windows_of_a_fit_recording_are_off_too_those_of_held_out_ones_say_nothing():
    predictions = {"a.csv": fitted((6.0,) * 4), "c.csv": fitted(), "b.csv": held_out((40.0,) * 4)}
    assert contradictions(predictions, True) == ()


def test_what_one_fit_recording_leaves_is_no_fault_of_it_where_a_held_out_one_is_off_too():
    predictions = {"a.csv": fitted((6.0,) * 4), "c.csv": fitted(), "b.csv": held_out((40.0,) * 4)}
    [found] = contradictions(predictions, False, {"hub_torque"})
    assert (found.recording, found.reference, found.limit) == ("b.csv", "one", 2.0)
    assert "one of the fit recordings is not explained either" in in_words(found, "the hub angle")
    assert contradictions(predictions, False, {"strain_base"}) == ()
    good = {**predictions, "b.csv": held_out(QUIET)}
    assert contradictions(good, False, {"hub_torque"}) == ()


def test_effects_that_make_the_windows_worse_contradict():
    predictions = {"a.csv": fitted((6.0,) * 4), "b.csv": held_out((8.0,) * 4, calibrated=(5.0,) * 4)}
    [found] = contradictions(predictions, True)
    assert found.reference == "calibrated"
    assert "without the effects" in in_words(found, "the hub angle")


def test_without_effects_the_calibrated_model_is_the_final_one():
    predictions = {"a.csv": fitted((6.0,) * 4), "b.csv": held_out((8.0,) * 4, calibrated=(5.0,) * 4)}
    assert contradictions(predictions, False) == ()


def test_without_windows_nothing_is_contradicted():
    predictions = {"a.csv": fitted(()), "b.csv": held_out((), calibrated=())}
    assert contradictions(predictions, True) == ()


def test_what_a_right_effect_may_leave_of_a_large_error_contradicts_nothing():
    predictions = {"a.csv": fitted(), "b.csv": held_out((20.0,) * 4, before=(500.0,) * 4)}
    assert contradictions(predictions, True) == ()


def test_a_model_that_predicts_the_whole_run_is_not_contradicted_by_windows():
    held = held_out((30.0,) * 4)
    budget = held.budget["hub_angle"]
    held.budget["hub_angle"] = replace(budget, after=replace(budget.after, rms=NOISE))
    assert contradictions({"a.csv": fitted(), "b.csv": held}, True) == ()
