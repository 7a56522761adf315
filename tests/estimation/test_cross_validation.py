"""Each recording as the others predict it: held against fits without it."""

from types import SimpleNamespace

import numpy as np
import pytest

from twin.diagnosis import rules
from twin.estimation import cross_validation, loss
from twin.estimation.unknowns import Unknown
from twin.estimation.workbench import Workbench
from twin.residuals.groups import Group

ROWS, RECORDINGS = 40, 4


def bench():
    groups = [Group(i, "hub_torque", slice(i * ROWS, (i + 1) * ROWS)) for i in range(RECORDINGS)]
    return SimpleNamespace(
        groups=groups,
        weight=np.ones(ROWS * RECORDINGS),
        count=np.full(RECORDINGS, float(ROWS)),
        # Below one noise level every group counts alike, whatever its size.
        sizes=lambda residual: np.full(RECORDINGS, 1.0),
    )


def fitted(columns, data, prior=None, rows=slice(None)):
    """The fit of a line of data to columns (n x p), on some rows."""
    A, y = columns[rows], data[rows]
    precision = np.diag([0.0 if p is None else 1 / p**2 for p in prior or [None] * columns.shape[1]])
    values = np.linalg.solve(A.T @ A + precision, A.T @ y)
    unknowns = [
        Unknown("rig", f"p{k}", 0.0, p, True, (-1e3, 1e3))
        if p
        else Unknown("effect", f"p{k}", 0.0, 1.0, False, (-1e3, 1e3), effect="play")
        for k, p in enumerate(prior or [None] * columns.shape[1])
    ]
    return SimpleNamespace(
        unknowns=unknowns, values=values, residual=data - columns @ values, jacobian=-columns
    )


@pytest.mark.parametrize("prior", [None, [0.1, None]])
def test_of_a_linear_model_it_is_the_fit_without_the_recording(prior):
    random = np.random.default_rng(3)
    columns = random.normal(size=(ROWS * RECORDINGS, 2))
    data = columns @ [0.4, -0.3] + random.normal(size=len(columns))
    predicted = cross_validation.residual(bench(), fitted(columns, data, prior))
    for group in bench().groups:
        others = np.delete(np.arange(len(data)), group.rows)
        alone = fitted(columns, data, prior, others).values
        np.testing.assert_allclose(predicted[group.rows], (data - columns @ alone)[group.rows], atol=1e-6)


def test_what_one_recording_alone_tells_is_kept():
    random = np.random.default_rng(4)
    columns = random.normal(size=(ROWS * RECORDINGS, 2))
    columns[ROWS:, 1] = 0.0  # the state at the first sample of the first recording
    data = columns @ [0.4, -0.3] + random.normal(size=len(columns))
    whole = fitted(columns, data)
    predicted = cross_validation.residual(bench(), whole)
    alone = fitted(columns[:, :1], data, None, slice(ROWS, None)).values
    np.testing.assert_allclose(
        predicted[:ROWS], (data - columns @ [alone[0], whole.values[1]])[:ROWS], atol=1e-6
    )


def test_of_one_effect_alone_all_else_stays_as_all_recordings_tell_it():
    random = np.random.default_rng(5)
    columns = random.normal(size=(ROWS * RECORDINGS, 2))
    data = columns @ [0.04, -0.3] + random.normal(size=len(columns))
    whole = fitted(columns, data, [0.1, None])
    predicted = cross_validation.residual(bench(), whole, "play")
    own, rest = columns[:, 1], data - columns[:, 0] * whole.values[0]
    for group in bench().groups:
        others = np.delete(np.arange(len(data)), group.rows)
        value = own[others] @ rest[others] / (own[others] @ own[others])
        np.testing.assert_allclose(predicted[group.rows], (rest - own * value)[group.rows], atol=1e-6)


def test_an_effect_is_adopted_though_the_calibration_without_a_decay_goes_astray(monkeypatch):
    gained = np.repeat([400.0, 50.0, 12.0, -1.0], ROWS)
    astray = gained - np.repeat([0.0, 0.0, 0.0, 250.0], ROWS)
    base, best = SimpleNamespace(residual=gained, name="base"), SimpleNamespace(name="best")
    told = {
        ("base", None): astray,
        ("best", None): np.zeros(len(gained)),
        ("best", "play"): np.zeros(len(gained)),
    }
    monkeypatch.setattr(cross_validation, "residual", lambda _, found, effect=None: told[found.name, effect])
    monkeypatch.setattr(loss, "loss", lambda sizes: sizes)
    means = SimpleNamespace(**{**vars(bench()), "sizes": lambda r: r.reshape(RECORDINGS, ROWS).mean(axis=1)})
    means.prepared, means.count = range(RECORDINGS), np.ones(RECORDINGS)
    means.by_recording = lambda of_blocks: Workbench.by_recording(means, of_blocks)
    found = rules.gain_elsewhere(means, base, SimpleNamespace(fit=best, name="play"))
    assert found == pytest.approx(50 + 12 - 1)
