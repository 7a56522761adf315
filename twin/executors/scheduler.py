"""Workers of a Dask scheduler, on this machine or on others, as an executor."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib.metadata import version
from types import ModuleType
from typing import Any

from twin.errors import InputError, quoted
from twin.files import extras

_PACKAGE = "flexlink-twin"
_ADDRESS = re.compile(r"(\w+://)?[^\s/]+:\d{1,5}")
_CONNECTING = 10.0  # s until a scheduler that does not answer is given up
_WORKERS_COME = (
    30.0  # s until one that has no worker is given up: a new worker loads its libraries for some seconds
)
_LARGEST_TASK = "1 GB"
"""Dask warns of tasks beyond this; by default of 10 MB, which the recordings of a campaign exceed."""


@contextmanager
def scheduler(address: str) -> Iterator[Executor]:
    """Yields an executor of the workers of a Dask scheduler; tasks that still wait at the end are cancelled.

    Args:
      address: as `tcp://192.168.0.10:8786`.

    Raises:
      InputError: Dask is not installed, or the scheduler or its workers cannot be used.
    """
    needed = "workers of a scheduler are reached with Dask (package distributed)"
    distributed = extras.imported("distributed", needed, "fleet", "; or leave the scheduler out")
    dask = extras.imported("dask", needed, "fleet")
    _silence()
    with dask.config.set({"distributed.admin.large-graph-warning-threshold": _LARGEST_TASK}):
        client = _connected(distributed, address)
        try:
            _check_workers(client, address)
            # Each task is one of its own: its result is not that of an earlier one with equal arguments.
            yield client.get_executor(pure=False)
        finally:
            client.close()


def _silence() -> None:
    """Keeps what Dask says of lost connections off the screen: the errors that are raised say it."""
    for name in ("distributed", "distributed.client", "distributed.core", "distributed.comm"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


def _connected(distributed: ModuleType, address: str) -> Any:
    expected = "expected the address that `dask scheduler` prints, as tcp://192.168.0.10:8786"
    if not _ADDRESS.fullmatch(address):
        raise InputError(f"the scheduler {quoted(address)} is no address; {expected}")
    try:
        return distributed.Client(address, timeout=_CONNECTING, set_as_default=False)
    except (OSError, ValueError) as error:
        why = _first_line(error)
        raise InputError(f"the scheduler {quoted(address)} does not answer ({why}); {expected}") from None


def _check_workers(client: Any, address: str) -> None:
    """Raises InputError where the scheduler has no worker, or one without this version of the package."""
    try:
        client.wait_for_workers(1, timeout=_WORKERS_COME)
    except TimeoutError:
        raise InputError(
            f"the scheduler {address} has no worker; start one on each machine with `dask worker {address}`"
        ) from None
    found = client.run(_installed, on_error="return")
    here = version(_PACKAGE)
    for worker, there in found.items():
        if there != here:
            has = f"{_PACKAGE} {there}" if isinstance(there, str) else f"no {_PACKAGE} ({_first_line(there)})"
            raise InputError(
                f"the worker {worker} of the scheduler {address} has {has}; expected {here}, which is here"
            )


def _installed() -> str:
    return version(_PACKAGE)


def _first_line(error: object) -> str:
    return next(iter(str(error).splitlines()), "") or type(error).__name__
