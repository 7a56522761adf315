"""The error of a play is found by repeated fits: its likelihood has many minima beside each other."""

from dataclasses import replace

import numpy as np
import pytest

from twin.estimation import repeated_fits
from twin.estimation.minimise import minimise
from twin.estimation.unknowns import effect_unknowns
from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.plant import CONTACT_DAMPING, CONTACT_STIFFNESS
from twin.mechanics.state import Start
from twin.recording import GAUGES, Recording, Sensor
from twin.residuals.data import DrivenData
from twin.residuals.prepared import prepare
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

NOISE = {"hub_angle": 3e-4, "strain_base": 2e-6}
SENSORS = {
    "hub_angle": Sensor("hub_angle"),
    "strain_base": GAUGES[0],
    "torque_command": Sensor("torque_command"),
}
TIME = 0.004 * np.arange(1500)
PLAY = {
    "backlash": {
        "gap": 0.015,
        "motor_inertia_share": 0.3,
        "contact_stiffness": CONTACT_STIFFNESS,
        "contact_damping": CONTACT_DAMPING,
    }
}


def rig(effects):
    declared = preset("bossi2009")
    return Model(declared, SENSORS, chain.fit_shape(declared, 5), effects, 2e-3)


def measured(model, seed):
    """A noisy recording of a model under sines."""
    phase = 2 * np.pi * np.outer(TIME - 0.3, (0.7, 1.1, 1.9, 3.1, 4.3))
    command = np.where(TIME < 0.3, 0.0, 0.08 * np.sin(phase).sum(axis=1))
    blank = {"torque_command": command, **{c: np.zeros_like(TIME) for c in NOISE}}
    run, draw = simulate(model, Recording("a.csv", TIME, blank), Start()), np.random.default_rng(seed)
    noisy = {c: run[c] + n * draw.standard_normal(len(TIME)) for c, n in NOISE.items()}
    return Recording("a.csv", TIME, {"torque_command": command, **noisy})


def fitted(model, seed, pool):
    """Data of a recording, and the model of its play fitted to them from parameters that are not quite right."""
    recording = prepare(measured(model, seed), NOISE)[0]
    bench = Workbench(DrivenData.of([recording], model), pool)
    unknowns = [u for name, p in model.effects.items() for u in effect_unknowns(name, p, set(NOISE))]
    first = np.array([u.start * (0.9 if u.name == "gap" else 1.0) for u in unknowns])
    return bench, minimise(bench, model, (Start(),), unknowns, first)


def test_the_error_of_a_play_covers_the_truth(pool):
    truth, away, own = rig(PLAY), [], []
    for seed in range(3):
        bench, found = fitted(truth, seed, pool)
        best, added = repeated_fits.likeliest_with_scatter(bench, found)
        assert best.cost <= found.cost
        assert (np.linalg.eigvalsh(added) > -1e-12).all()
        corrected = repeated_fits.without_bias(bench, replace(best, covariance=best.covariance + added))
        told = [k for k, u in enumerate(best.unknowns) if u.name in ("gap", "motor_inertia_share")]
        true = [PLAY["backlash"][best.unknowns[k].name] for k in told]
        away.append((corrected.values[told] - true) / corrected.errors[told])
        own.append((found.values[told] - true) / found.errors[told])
    assert np.abs(away).max() < 3
    assert np.mean(np.square(away)) < 0.5 * np.mean(np.square(own))


def test_only_a_play_takes_repeated_fits(pool):
    smooth = rig({"viscous-friction": {"viscous": 0.02}})
    bench, found = fitted(smooth, 0, pool)
    best, added = repeated_fits.likeliest_with_scatter(bench, found)
    assert best is found
    assert not added.any()
    assert not repeated_fits.is_repeated(bench, found)


def test_the_noise_of_the_second_simulation_is_the_opposite(pool):
    model = rig(PLAY)
    recording = prepare(measured(model, 0), NOISE)[0]
    missing = np.array(recording.recording["strain_base"])
    missing[100:120] = np.nan
    gap = replace(recording.recording, channels={**recording.recording.channels, "strain_base": missing})
    given = (replace(recording, recording=gap), model, Start())
    runs = [repeated_fits._simulation((*given, np.random.default_rng(1), sign)).recording for sign in (1, -1)]
    clean = simulate(model, gap, Start())
    for channel, noise in NOISE.items():
        mean, half = (runs[0][channel] + runs[1][channel]) / 2, (runs[0][channel] - runs[1][channel]) / 2
        assert not np.isfinite(mean[~np.isfinite(gap[channel])]).any()
        # An impact may have been taken for an outlier.
        known = np.isfinite(mean)
        assert np.mean(known) > 0.95
        np.testing.assert_allclose(mean[known], clean[channel][known], atol=1e-9)
        assert np.std(half[known]) == pytest.approx(noise, rel=0.1)
