"""Workers of a Dask scheduler, on this machine or on others, as an executor."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from functools import partial
from importlib.metadata import version
from types import ModuleType
from typing import Any, TypeVar

from twin.errors import InputError, quoted
from twin.files import extras

T = TypeVar("T")
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
            yield _Workers(client)
        finally:
            client.close()


class _Workers(Executor):
    """The workers of a Dask client. Every task ends: as cancelled, where the scheduler ends before its result is here.

    The executor of the client itself leaves a task without an end whose result is on its way just then.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def submit(self, task: Callable[..., T], /, *given: Any, **named: Any) -> Future[T]:
        ours: Future[T] = Future()
        try:
            # Each task is one of its own: its result is not that of an earlier one with equal arguments.
            theirs = self._client.submit(partial(task, **named), *given, pure=False)
        except Exception:
            if self._client.status != "closed":
                raise
            ours.set_exception(CancelledError("the scheduler has ended"))
            return ours
        theirs.add_done_callback(partial(_pass_on, ours))
        ours.add_done_callback(partial(_cancel, theirs))
        return ours


def _pass_on(ours: Future[T], theirs: Any) -> None:
    """Gives a future the result, or the error, of one of Dask that has ended."""
    if not ours.set_running_or_notify_cancel():
        return
    try:
        ours.set_result(theirs.result())
    except BaseException as error:
        # What a task raises is its own error; all else is a result that is lost.
        ours.set_exception(error if theirs.status == "error" else CancelledError(str(error)))


def _cancel(theirs: Any, ours: Future[Any]) -> None:
    """Ends a task of Dask that is not wanted any more."""
    if ours.cancelled() and theirs.status != "cancelled":
        theirs.cancel()


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
