"""Residuals that processes compute together: the same as of one process, whatever becomes of the others."""

import importlib
import os
import signal
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from twin import effects
from twin.effects import ViscousFriction
from twin.estimation import residual_pool
from twin.estimation.residual_pool import ResidualPool
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.rigs import preset
from twin.rigs.model import Model

RIG = preset("bossi2009")
MODEL = Model(RIG, {}, chain.uniform_shape(3))


@pytest.fixture(autouse=True)
def numbered(monkeypatch):
    """Recordings that new processes can import."""
    monkeypatch.syspath_prepend(Path(__file__).parent / "modules")
    monkeypatch.setattr(residual_pool, "_idle", [])
    yield importlib.import_module("numbered_recordings").Numbered
    for helper in residual_pool._idle:
        helper._process.shutdown()


def tasks(stiffnesses=(1.0, 2.0)):
    models = [MODEL.replace(declared=RIG.replace("test", bending_stiffness=s)) for s in stiffnesses]
    return [(i, model, Start()) for model in models for i in range(4)]


def told(pool, data, given=None):
    """Recording, stiffness and process (tasks x 3)."""
    return np.array([parts["told"] for parts in pool.residuals(data, given or tasks())])


def test_each_task_has_its_residual_whoever_computes_it(numbered):
    with ResidualPool(1) as one, ResidualPool(2) as two:
        alone, together = told(one, numbered()), told(two, numbered())
    np.testing.assert_array_equal(alone[:, :2], together[:, :2])
    np.testing.assert_array_equal(alone[:, :2], [(t[0], t[1].rig["bending_stiffness"]) for t in tasks()])
    assert set(alone[:, 2]) == {os.getpid()}
    assert len(set(together[:, 2])) == 2


def test_a_recording_stays_with_its_process(numbered):
    """What is simulated for one of its tasks serves the others; one recording may be on the border."""
    with ResidualPool(2) as pool:
        found = told(pool, numbered(), given=tasks((1.0, 2.0, 3.0)))
    processes = [len(set(found[found[:, 0] == i, 2])) for i in range(4)]
    assert sum(count - 1 for count in processes) <= 1


def test_shares_take_the_same_time():
    times = np.array([5.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    given = [(i, MODEL, Start()) for i in range(6)]
    assert residual_pool._split(given, times, 2) == [[0], [1, 2, 3, 4, 5]]
    assert residual_pool._split([], np.zeros(0), 2) == [[], []]


def test_a_process_serves_the_next_pool(numbered):
    with ResidualPool(2) as pool:
        before = told(pool, numbered())
    with ResidualPool(2) as pool:
        after = told(pool, numbered())
    np.testing.assert_array_equal(before, after)


def test_more_data_than_a_process_keeps(numbered):
    many = [numbered() for _ in range(residual_pool._KEPT + 2)]
    with ResidualPool(2) as pool:
        found = [told(pool, data) for data in many + many]
    for one in found:
        np.testing.assert_array_equal(one[:, :2], found[0][:, :2])


def test_what_a_process_that_ends_has_not_computed_is_computed_here(numbered):
    with ResidualPool(2) as pool:
        first = told(pool, numbered())
        [other] = set(first[:, 2]) - {os.getpid()}
        os.kill(int(other), signal.SIGTERM)
        second, third = told(pool, numbered()), told(pool, numbered())
    np.testing.assert_array_equal(first[:, :2], second[:, :2])
    assert set(third[:, 2]) == {os.getpid()}
    with ResidualPool(2) as pool:
        assert len(set(told(pool, numbered())[:, 2]) - {other}) == 2


def test_an_effect_of_a_script_is_computed_where_it_is_known(numbered):
    class Own(ViscousFriction):
        name = "own-friction"

    effects.register(Own())
    try:
        with ResidualPool(2) as pool:
            assert set(told(pool, numbered())[:, 2]) == {os.getpid()}
    finally:
        effects.unregister("own-friction")


def test_a_daemon_computes_all_itself(numbered, monkeypatch):
    monkeypatch.setattr(
        residual_pool.multiprocessing, "current_process", lambda: SimpleNamespace(daemon=True)
    )
    with ResidualPool(2) as pool:
        assert set(told(pool, numbered())[:, 2]) == {os.getpid()}
