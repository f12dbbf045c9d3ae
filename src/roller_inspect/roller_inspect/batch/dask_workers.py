"""Jobs on the workers of a Dask scheduler."""

from __future__ import annotations

import sys
from asyncio import CancelledError
from collections.abc import Iterator, Sequence

from roller_core.errors import RollerError

from . import jobs
from .jobs import Job, Row

#: How long a scheduler may take to answer, and to have a worker, s.
_PATIENCE_S = 10
#: Asked of each worker; in words that one without our packages understands.
_KNOWS_US = "__import__('importlib.util').util.find_spec('roller_inspect') is not None"


class SchedulerError(RollerError):
    """A scheduler that doesn't answer, or whose workers can't do jobs."""


def rows_of_workers(todo: Sequence[Job], address: str) -> Iterator[Row]:
    """Rows as they come; a job that can't be done is one too.

    Parameters
    ----------
    todo : sequence of Job
        What to do.
    address : str
        Of the scheduler, such as ``tcp://127.0.0.1:8786``.

    Raises
    ------
    SchedulerError
        If there is no Dask, no scheduler, no worker, or one that lacks this workspace.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise SchedulerError(
            f"--scheduler needs dask ({sys.executable} -m pip install dask distributed)"
        ) from error
    try:
        client = Client(address, timeout=_PATIENCE_S)
    except (OSError, ValueError) as error:
        raise SchedulerError(f"{address}: no Dask scheduler answers there ({error})") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_PATIENCE_S)
        except TimeoutError as error:
            raise SchedulerError(
                f"{address}: the scheduler has no workers; start some: dask worker {address}"
            ) from error
        for worker, knows in client.run(eval, _KNOWS_US, on_error="return").items():
            if knows is not True:
                raise SchedulerError(
                    f"{address}: the worker {worker} has no roller_inspect; start it with this "
                    f"workspace's Python (.venv/bin/dask worker {address})"
                )
        futures = {client.submit(jobs.run_job, job, pure=False): job for job in todo}
        for future in as_completed(futures):
            try:
                yield future.result()
            except (Exception, CancelledError) as error:
                # A worker that died of it, time after time; or the scheduler did.
                said = " ".join(str(error).split()) or type(error).__name__
                yield jobs.failed(futures[future], f"its worker gave it up: {said}")
