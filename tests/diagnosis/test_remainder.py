"""When the residual of a channel is more than noise and a right model leave."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from twin.diagnosis import diagnose, remainder
from twin.diagnosis.state import SearchState
from twin.estimation import output_error
from twin.residuals.groups import Group

ROWS, INDEPENDENT = 1000, 100.0


def seen(sizes, before=None, independent=INDEPENDENT):
    """What a search came to on recordings whose residuals have these sizes: channel -> one of each recording."""
    groups, noise = [], []
    for channel, of_channel in sizes.items():
        for recording in range(len(of_channel)):
            row = ROWS * len(groups)
            groups.append(Group(recording, channel, slice(row, row + ROWS)))
            noise.append(np.where(np.arange(ROWS) % 2, 1.0, -1.0))
    data = SimpleNamespace(groups=groups)
    recordings = max(len(s) for s in sizes.values())
    bench = SimpleNamespace(
        data=data,
        groups=groups,
        weight=np.ones(ROWS * len(groups)),
        count=np.full(len(groups), independent),
        prepared=range(recordings),
    )

    def fit(of):
        flat = [size for of_channel in of.values() for size in of_channel]
        residual = np.concatenate([size * n for size, n in zip(flat, noise, strict=True)])
        plant = SimpleNamespace(friction=SimpleNamespace(stribeck_velocity=0.0))
        return SimpleNamespace(residual=residual, model=SimpleNamespace(plant=plant))

    start = SimpleNamespace(bench=bench)
    return SimpleNamespace(
        start=start,
        bench=bench,
        base=fit(before or sizes),
        best=fit(sizes),
        gained=0.0,
        unnamed=(),
        on_output_errors=False,
    )


@pytest.mark.parametrize(
    ("sizes", "left"),
    [
        ({"strain_base": [1.0, 1.1, 0.9], "hub_torque": [1.4, 1.4, 1.4]}, ()),
        ({"strain_base": [3.0, 3.0, 1.0], "hub_torque": [1.0, 1.0, 1.0]}, ("strain_base",)),
        # A lone recording may be odd.
        ({"strain_base": [30.0, 1.1, 1.0], "hub_torque": [1.0, 1.0, 1.0]}, ()),
        # A fault that one experiment provokes and another barely shows.
        ({"motor_torque": [4.5, 1.8, 0.9]}, ("motor_torque",)),
        ({"hub_torque": [3.0, 4.0], "strain_base": [9.0, 8.0]}, ("strain_base", "hub_torque")),
        # Instants are no recordings.
        ({"departure": [9.0, 9.0], "break_away": [9.0, 9.0]}, ()),
    ],
)
def test_what_stays_above_the_noise_in_several_recordings_is_not_explained(sizes, left):
    assert remainder.unexplained_channels(seen(sizes)) == left


def test_one_recording_is_enough_where_there_is_no_other():
    assert remainder.unexplained_channels(seen({"strain_base": [3.0]})) == ("strain_base",)


def test_a_right_effect_may_leave_a_small_part_of_what_it_explains():
    left = {"hub_torque": [3.0, 2.5]}
    assert remainder.unexplained_channels(seen(left, before={"hub_torque": [100.0, 80.0]})) == ()
    assert remainder.unexplained_channels(seen(left, before={"hub_torque": [10.0, 8.0]})) == ("hub_torque",)


def test_the_size_of_little_noise_is_not_known_well():
    assert remainder.unexplained_channels(seen({"hub_torque": [2.4, 2.4]}, independent=5.0)) == ()
    assert remainder.unexplained_channels(seen({"hub_torque": [2.4, 2.4]}, independent=500.0)) == (
        "hub_torque",
    )


def test_a_lone_recording_is_named_though_it_is_no_verdict():
    found = seen({"strain_base": [30.0, 1.1, 1.0], "hub_torque": [3.0, 3.0, 1.0]})
    [(recording, channel, size)] = remainder.in_one_recording(found)
    assert (recording, channel) == (0, "strain_base")
    assert size == pytest.approx(30.0, rel=0.2)
    assert remainder.unexplained_channels(found) == ("hub_torque",)


def test_a_channel_that_is_quieter_than_declared_is_told():
    found = seen({"strain_base": [0.1, 0.12, 1.0], "strain_mid": [0.8, 0.9, 0.7], "departure": [0.1]})
    assert remainder.overstated_noise(found) == {"strain_base": pytest.approx(0.12, rel=0.01)}


@dataclass(frozen=True)
class Begun:
    """A search without effects: its data and its calibration."""

    bench: SimpleNamespace
    base: SimpleNamespace


@pytest.mark.parametrize(
    ("size", "misfit", "used"), [(1.5, 90.0, True), (1.5, 110.0, False), (2.5, 90.0, False)]
)
def test_output_errors_are_used_where_they_are_explained_and_leave_less(monkeypatch, size, misfit, used):
    """A stick may leave them explained with a wrong friction, and then more than driven data."""

    def data(size, misfit):
        return SimpleNamespace(sizes=lambda r: np.array([size]), misfit=lambda r: misfit)

    fit = SimpleNamespace(residual=np.zeros(1))
    state = SearchState(Begun(data(1.2, 100.0), fit))
    free = data(size, misfit)
    monkeypatch.setattr(output_error, "fit_output_error", lambda bench, fit, most: (free, fit))
    after, _ = diagnose.on_output_errors(state, True, lambda text: None, 2.0)
    assert (after.bench is free) == used
