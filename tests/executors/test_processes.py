"""Processes that run tasks: one that ends takes its task along, and none outlives the block."""

import multiprocessing
import os
import sys
import time
from concurrent.futures.process import BrokenProcessPool

import pytest

from twin.estimation import residual_pool
from twin.executors import lost_its_process
from twin.executors.processes import processes


@pytest.fixture(autouse=True)
def no_others():
    """Processes that wait for the next diagnosis are ended before."""
    while residual_pool._idle:
        residual_pool._idle.pop()._process.shutdown()
    assert multiprocessing.active_children() == []


def test_a_process_that_ends_takes_its_task_along_and_is_replaced():
    script = vars(sys.modules["__main__"]).get("__file__")
    with processes(1) as pool:
        first = pool.submit(os.getpid).result()
        with pytest.raises(BrokenProcessPool) as lost:
            pool.submit(os._exit, 1).result()
        assert lost_its_process(lost.value)
        second = pool.submit(os.getpid).result()
    assert len({first, second, os.getpid()}) == 3
    assert vars(sys.modules["__main__"]).get("__file__") == script
    assert multiprocessing.active_children() == []


def test_an_error_in_the_block_ends_what_runs_at_once():
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt), processes(1) as pool:
        _begin_and_stop(pool)
    assert time.monotonic() - began < 30
    assert multiprocessing.active_children() == []


def _begin_and_stop(pool):
    for _ in range(2):
        pool.submit(time.sleep, 60)
    raise KeyboardInterrupt
