"""Windows that begin anew from the measured state: noise is no error of the model, and drift ends with each."""

import numpy as np
import pytest

from twin.diagnosis.windows import WINDOW, simulate_windows
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import GAUGES, Recording, Sensor
from twin.residuals.prepared import prepare
from twin.rigs import preset
from twin.rigs.model import Model, with_fine_chain
from twin.rigs.simulate import simulate

TIME = 0.004 * np.arange(1130)  # four windows and a rest
SQUARE = np.where(TIME < 0.5, 0.0, 0.3 * np.sign(np.sin(2 * np.pi * 0.9 * TIME)))
SENSORS = {"hub_angle": Sensor("hub_angle"), "strain_base": GAUGES[0]}
FINE, ROUGH = {"hub_angle": 1e-4, "strain_base": 2e-6}, {"hub_angle": 1e-3, "strain_base": 5e-6}


def model(**effects):
    declared = preset("bossi2009")
    named = {name.replace("_", "-"): p for name, p in effects.items()}
    return Model(declared, SENSORS, chain.fit_shape(declared, 8), named)


def measured(truth, noise, clamped=False, seed=0, command=SQUARE):
    channels = {"torque_command": command, **{c: np.zeros_like(TIME) for c in noise}}
    run = simulate(truth, Recording("a.csv", TIME, channels, clamped), Start())
    draw = np.random.default_rng(seed)
    noisy = {c: run[c] + sigma * draw.standard_normal(len(TIME)) for c, sigma in noise.items()}
    return Recording("a.csv", TIME, {"torque_command": command, **noisy}, clamped)


def in_windows(told, recording, noise):
    """Windows of a model, and the root-mean-square error of each channel over its noise in them and in a free run."""
    ready, _ = prepare(recording, noise)
    free = simulate(told, ready.recording, Start())
    windows = simulate_windows(told, ready, Start(), free)
    inside = windows.inside
    off = {c: [(recording[c] - run[c])[inside] for run in (windows.readings, free)] for c in noise}
    return windows, {
        c: [float(np.sqrt(np.nanmean(v**2))) / noise[c] for v in pair] for c, pair in off.items()
    }


@pytest.fixture(scope="module")
def viscous():
    return measured(model(viscous_friction={"viscous": 0.02}), ROUGH)


def test_the_right_model_leaves_the_noise_of_a_rough_hub_sensor(viscous):
    """From the measured state alone the hub is off by 14; what is left above 1 is by the fitted state."""
    windows, sizes = in_windows(model(viscous_friction={"viscous": 0.02}), viscous, ROUGH)
    assert max(max(pair) for pair in sizes.values()) < 1.6, sizes
    assert np.unique(windows.window).tolist() == [-1, 0, 1, 2, 3]
    np.testing.assert_array_equal(
        windows.window == 2, (TIME > 2 * WINDOW - 1e-9) & (TIME < 3 * WINDOW - 1e-9)
    )


def test_a_hub_that_shakes_the_link_beyond_the_low_pass_has_the_state_of_an_observer():
    """From the measured state, of which 63 Hz are filtered away, the hub is off by 50."""
    shaken = np.where(
        TIME < 0.3, 0.0, 0.6 * np.sign(np.sin(2 * np.pi * 63 * TIME + 0.4)) + 0.4 * np.sign(SQUARE)
    )
    recording = measured(with_fine_chain(model()), FINE, command=shaken)
    _, sizes = in_windows(model(), recording, FINE)
    assert sizes["hub_angle"][0] < 2
    assert sizes["strain_base"][0] < 2


def test_a_wrong_model_is_off_in_windows_but_does_not_drift(viscous):
    _, sizes = in_windows(model(), viscous, ROUGH)
    in_window, free = sizes["hub_angle"]
    assert 20 < in_window < free / 3


def test_sticks_and_slips_of_a_fine_sensor_are_followed():
    _, sizes = in_windows(model(), measured(with_fine_chain(model()), FINE), FINE)
    assert sizes["hub_angle"][0] < 6


def test_a_lagging_drive_has_reached_at_each_start_what_it_has_reached():
    lag = model(actuator_lag={"time_constant": 0.08})
    sizes = [in_windows(lag, measured(lag, ROUGH, seed=seed), ROUGH)[1] for seed in range(5)]
    # One step of least squares to the readings before a window, where a hub may stick, leaves 1.5.
    assert np.median([s["hub_angle"][0] for s in sizes]) < 1.3, sizes
    assert np.median([s["strain_base"][0] for s in sizes]) < 1.2, sizes


def test_drift_of_a_gauge_is_counted_from_the_first_sample():
    drift = model(strain_drift={"rate_base": 1e-4, "rate_mid": 0.0})
    recording = measured(drift, ROUGH)
    assert in_windows(drift, recording, ROUGH)[1]["strain_base"][0] < 1.2
    assert in_windows(model(), recording, ROUGH)[1]["strain_base"][0] > 20


def test_a_window_uses_no_reading_inside_it(viscous):
    told = model()
    late = TIME > 3.2
    angle = np.where(late, viscous["hub_angle"] + 0.5, viscous["hub_angle"])
    changed = viscous.replace(channels={**viscous.channels, "hub_angle": angle})
    (one, _), (other, _) = (in_windows(told, r, ROUGH) for r in (viscous, changed))
    np.testing.assert_allclose(one.readings["hub_angle"], other.readings["hub_angle"], atol=1e-9)


def test_the_first_window_is_that_of_the_free_run(viscous):
    """Its state is known better than by a low-pass that ends at the first sample: of a moving hub, by 80 to 1."""
    told, moving = (
        model(viscous_friction={"viscous": 0.02}),
        viscous.part(TIME > 0.7).replace(start="unknown"),
    )
    ready, _ = prepare(moving, ROUGH)
    start = Start(float(moving["hub_angle"][0]), 1.0)
    free = simulate(told, ready.recording, start)
    windows = simulate_windows(told, ready, start, free)
    first = windows.window == 0
    assert first.sum() == 250
    np.testing.assert_array_equal(windows.readings["hub_angle"][first], free["hub_angle"][first])


def test_no_window_begins_where_the_hub_is_not_read(viscous):
    gap = (TIME > 1.9) & (TIME < 2.1)
    angle = np.where(gap, np.nan, viscous["hub_angle"])
    windows, _ = in_windows(
        model(), viscous.replace(channels={**viscous.channels, "hub_angle": angle}), ROUGH
    )
    assert np.unique(windows.window).tolist() == [-1, 0, 1, 3]
    assert np.isnan(windows.readings["hub_angle"][windows.window == -1]).all()


def test_a_locked_hub_or_a_short_recording_has_none():
    noise = {"strain_base": 5e-6}
    for recording, levels in (
        (measured(model(), noise, clamped=True), noise),
        (measured(model(), ROUGH).part(TIME < 0.9), ROUGH),
    ):
        ready, _ = prepare(recording, levels)
        assert simulate_windows(model(), ready, Start(), recording) is None
