"""The error budget: root mean squares and fits of whole runs and windows, and what is said of them."""

import math

import numpy as np
import pytest

from twin.diagnosis import predict
from twin.diagnosis.answer import MODELS, Prediction
from twin.diagnosis.budget_text import main_budget, pooled, sentences
from twin.diagnosis.error_budget import ChannelBudget, ModelError, channel_budgets, model_errors
from twin.diagnosis.windows import Windowed
from twin.mechanics import chain
from twin.recording import GAUGES, Recording, Sensor
from twin.residuals.prepared import Prepared, prepare
from twin.rigs import preset
from twin.rigs.model import Model

TIME = 0.01 * np.arange(300)
ANGLE = np.sin(TIME)
NOISE = {"hub_angle": 1e-3, "strain_base": 1e-6}
MODEL = Model(
    preset("bossi2009"), {"hub_angle": Sensor("hub_angle"), "strain_base": GAUGES[0]},
    chain.fit_shape(preset("bossi2009"), 3),
)  # fmt: skip


def prepared(strain=1e-4 * ANGLE) -> Prepared:
    channels = {"torque_command": 0 * TIME, "hub_angle": ANGLE, "strain_base": strain}
    return prepare(Recording("a.csv", TIME, channels, start="unknown"), NOISE)[0]


def shifted(hub, strain=0.0):
    return Recording("a.csv", TIME, {"hub_angle": ANGLE + hub, "strain_base": 1e-4 * ANGLE + strain})


def test_fit_is_that_of_the_deviation_from_the_mean():
    error = model_errors(prepared(), MODEL, shifted(0.1), None)["hub_angle"]
    assert error.rms == pytest.approx(0.1)
    assert error.fit_percent == pytest.approx(100 * (1 - 0.1 / np.std(ANGLE)))
    assert math.isnan(error.rms_window)
    assert error.to_json() == {
        "rms": error.rms,
        "rms_window": None,
        "fit_percent": error.fit_percent,
        "fit_percent_window": None,
    }


def test_windows_are_told_one_by_one_and_what_lies_outside_them_is_left_out():
    window = np.where(TIME < 2.5, np.floor(TIME + 1e-9), -1).astype(int)
    window[window == 1] = -1
    off = np.select([window == 0, window == 2], [0.1, 0.2], np.nan)
    error = model_errors(prepared(), MODEL, shifted(1.0), Windowed(shifted(off), window))["hub_angle"]
    np.testing.assert_allclose(error.by_window, [0.1, np.nan, 0.2])
    assert error.rms_window == pytest.approx(math.sqrt((100 * 0.01 + 50 * 0.04) / 150))
    assert error.fit_percent_window == pytest.approx(
        100 * (1 - error.rms_window / np.std(ANGLE[window >= 0]))
    )


def test_the_unknown_zero_of_a_gauge_is_no_error_but_that_of_a_hub_is():
    errors = model_errors(prepared(), MODEL, shifted(0.1, 5e-5), None)
    assert errors["strain_base"].rms == pytest.approx(0.0, abs=1e-12)
    assert errors["hub_angle"].rms == pytest.approx(0.1)


def test_residuals_of_a_prediction_are_about_the_zero_that_its_errors_take_out():
    of = prepared()
    runs = [shifted(0.1 * k, 5e-5 * k + 1e-6 * k * np.sin(9 * TIME)) for k in (3, 2, 1)]
    zeros = {m: predict.unknown_zeros(of, run, ["strain_base"]) for m, run in zip(MODELS, runs, strict=True)}
    shown = Prediction("holdout", of.recording, *runs, errors={}, zeros=zeros)
    for channel in ("strain_base", "hub_angle"):
        error = predict.channel_error(of, channel, runs, runs, None, channel == "strain_base")
        for model in MODELS:
            left = shown.residual(model, channel)
            assert np.sqrt(np.mean(left**2)) == pytest.approx(getattr(error, model))
    assert max(error.before, error.calibrated) > 0.1
    assert np.abs(shown.residual("before", "strain_base")).max() < 1e-5


def test_a_reading_that_never_changes_has_no_fit():
    still = model_errors(prepared(np.zeros(300)), MODEL, shifted(0.0), None)["strain_base"]
    assert math.isnan(still.fit_percent)


def test_steps_are_named_and_the_last_one_is_the_final_model():
    stages = [{c: ModelError(size) for c in NOISE} for size in (4.0, 3.0, 2.0, 1.0)]
    budget = channel_budgets(prepared(), ["viscous-friction", "backlash"], stages)["hub_angle"]
    answer = budget.to_json()
    assert (answer["unit"], answer["window_s"], answer["noise"]) == ("rad", 1.0, 1e-3)
    assert [answer[name]["rms"] for name in ("before", "calibrated", "after")] == [4.0, 3.0, 1.0]
    assert [(s["effect"], s["rms"]) for s in answer["steps"]] == [
        ("viscous-friction", 2.0),
        ("backlash", 1.0),
    ]
    plain = channel_budgets(prepared(), [], stages[:2])["hub_angle"]
    assert plain.after == plain.calibrated


# In words


def degrees(*sizes, whole=60.0, effects=("viscous-friction", "backlash")):
    """The budget of a hub angle, in degrees."""
    errors = [ModelError(math.radians(whole), math.radians(size)) for size in sizes]
    steps = tuple(zip(effects, errors[2:], strict=True))
    return {"hub_angle": ChannelBudget("rad", math.radians(0.02), errors[0], errors[1], steps, errors[-1])}


def test_each_step_says_what_it_takes_away():
    said = sentences([degrees(68.0, 64.0, 7.0, 3.0)], ["hub_angle"], held_out=True)
    assert said == (
        "On held-out recordings, in windows of 1 s, the hub angle is off by 68° as declared: calibration takes 4.0° "
        "away, viscous friction 57°, backlash 4.0°; 3.0° is left and depends on the hub angle (sensor noise 0.020°). "
        "Over whole runs, in which errors add up, it is off by 60° before and 60° after."
    )


def test_a_step_that_adds_to_the_error_says_so():
    said = sentences([degrees(2.0, 3.0, 0.5, 0.501)], [], held_out=False)
    assert "On the fitted recordings (none was held out)" in said
    assert (
        "calibration adds 1.0°, viscous friction takes 2.5° away, backlash changes little; 0.50° is left ("
        in said
    )


def test_recordings_are_pooled_by_their_squares():
    found = pooled([degrees(3.0, 1.0, 1.0, 1.0), degrees(4.0, 1.0, 1.0, 1.0)], "hub_angle", in_windows=True)
    assert math.degrees(found.errors[0]) == pytest.approx(math.sqrt(12.5))
    assert main_budget([degrees(8.0, 4.0, 2.0, 1.0)]).share_by_effects == pytest.approx(0.75)


def test_a_run_that_diverges_is_not_told_and_none_says_nothing():
    assert sentences([], [], held_out=True) == ""
    budget = degrees(math.nan, 1.0, 1.0, 1.0)
    assert "over whole runs, the hub angle is off by 60°" in sentences([budget], [], held_out=True)
    assert sentences([degrees(math.nan, 1.0, 1.0, 1.0, whole=math.inf)], [], held_out=True) == ""
