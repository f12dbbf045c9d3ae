"""Work over all cores whose results are kept on disk, and taken again after a break."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from roller_core.opencv import one_opencv_thread
from roller_core.progress import Tell

from .tables import write_json

Json = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """A piece of work.

    Attributes
    ----------
    name : str
        Name of its file.
    asked : dict
        All that its result depends on, as JSON has it.
    run : callable
        Gives the result, a dict that JSON can hold; known to other processes by its name.
    arguments : tuple
        What it is called with.
    """

    name: str
    asked: Json
    run: Callable[..., Json]
    arguments: tuple[Any, ...]


def equal(kept: Json, asked: Json) -> bool:
    """Whether what was kept is what is asked for."""
    return kept == asked


def do_jobs(
    jobs: Sequence[Job],
    folder: Path,
    processes: int,
    tell: Tell,
    serves: Callable[[Json, Json], bool] = equal,
) -> dict[str, Json]:
    """Do jobs, or take what an earlier run left.

    Parameters
    ----------
    jobs : sequence of Job
        In the order in which they are begun.
    folder : path
        Where each one's result is kept.
    processes : int
        Processes; with one it is this process.
    tell : callable
        Told what was done and the share done, 0–1.
    serves : callable
        Told what was asked for when a result was kept, and what is asked for now: whether it
        will do.

    Returns
    -------
    dict
        Results by name.

    Raises
    ------
    UnwritableOutputError
        If results can't be kept.
    """
    results = {job.name: _kept(folder / f"{job.name}.json", job.asked, serves) for job in jobs}
    missing = [job for job in jobs if results[job.name] is None]

    def take(job: Job, found: Json) -> None:
        results[job.name] = found
        write_json({"asked": job.asked, "found": found}, folder / f"{job.name}.json")
        done = sum(result is not None for result in results.values())
        tell(job.name, done / len(jobs))

    if processes == 1 or len(missing) < 2:
        for job in missing:
            take(job, job.run(*job.arguments))
        return _all(results)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(processes, len(missing)), context, one_opencv_thread) as pool:
        futures = {pool.submit(job.run, *job.arguments): job for job in missing}
        try:
            for future in as_completed(futures):
                take(futures[future], future.result())
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return _all(results)


def _all(results: Mapping[str, Json | None]) -> dict[str, Json]:
    return {name: found for name, found in results.items() if found is not None}


def _kept(path: Path, asked: Json, serves: Callable[[Json, Json], bool]) -> Json | None:
    """The result of an earlier run, if it serves."""
    try:
        kept = json.loads(path.read_text())
        found: Json | None = kept["found"] if serves(kept["asked"], asked) else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return found
