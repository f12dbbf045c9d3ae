"""Jobs of a batch: what they are told apart by, and how one runs in a process of its own."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from roller_core.output_mark import MARK, entries_made
from roller_recording.reading import event_file

#: Of the child, before anything is loaded: it is asked to end when the batch is gone, however that
#: came, else it would hold its output folder against the next; and its memory is bounded.
_BOUND = (
    "import ctypes, os, resource, signal, sys; parent, n = map(int, sys.argv[1:3]); "
    "ctypes.CDLL(None).prctl(1, int(signal.SIGTERM), 0, 0, 0); "  # PR_SET_PDEATHSIG
    "os.getppid() == parent or sys.exit(1); del sys.argv[1:3]; "
    "n and resource.setrlimit(resource.RLIMIT_DATA, (n, n)); "
)
_CHILD = _BOUND + "from roller_inspect.commands.inspect import main; sys.exit(main())"
#: What Python and the libraries say where memory is short.
_LACKS_MEMORY = re.compile(r"memory|Memory|can't start new thread")
_SUFFIXES = (".mcap", ".db3", ".bag", *event_file.SUFFIXES)


@dataclass(frozen=True)
class Job:
    """One recording to inspect."""

    #: Hash of the recording, the recipe, the parameters and the software.
    key: str
    #: The recording, and the folder of its results.
    source: str
    output: str
    #: Of `roller inspect`.
    options: tuple[str, ...]
    #: Whether results of the key that are there count.
    resume: bool
    #: Limits; 0: none.
    timeout_s: float
    memory_bytes: int
    #: What it took in an earlier run, as far as is known.
    earlier_s: float | None = None


@dataclass(frozen=True)
class Row:
    """What came of a job; `error` is empty where it has a verdict and no faults.

    `kept`: its results, and the seconds that they took, are of an earlier run.
    """

    key: str
    source: str
    verdict: str
    reason: str
    measured: float | None
    findings: int | None
    deepest_m: float | None
    seconds: float | None
    error: str
    kept: bool = False


def find_recordings(
    folders: Sequence[Path], unread: Callable[[OSError], object] | None = None
) -> Iterator[Path]:
    """Recordings in folders: rosbag2 and dataset folders, and single files that lie in none.

    What a replay or an inspection wrote there is no recording. Links to folders are followed.
    `unread` is told of folders that can't be read.
    """
    for folder in folders:
        files = sorted(_files(folder, unread))
        bags = sorted({f.parent for f in files if f.name in ("metadata.yaml", "events.txt")})
        yield from (b for b in bags if not {b.name, "report.json"} <= entries_made(b.parent).keys())
        for path in files:
            if path.suffix.lower() in _SUFFIXES and not any(
                path.is_relative_to(bag) for bag in bags
            ):
                yield path


def poses_beside(recording: Path) -> Path | None:
    """Poses of a file of events alone, `scan.poses.txt` beside `scan.aedat4`, if they are there."""
    poses = recording.with_suffix(".poses.txt")
    events_alone = recording.suffix.lower() in event_file.SUFFIXES
    return poses if events_alone and poses.is_file() else None


def _files(folder: Path, unread: Callable[[OSError], object] | None) -> Iterator[Path]:
    """Files below a folder; of one that links lead to several times those of one place."""
    seen = set()
    for place, folders, names in os.walk(folder, onerror=unread, followlinks=True):
        folders.sort()
        whole = os.path.realpath(place)
        if whole in seen:  # or within itself
            folders.clear()
            continue
        seen.add(whole)
        yield from (Path(place, name) for name in names)


def run_job(job: Job) -> Row:
    """Inspect one recording; whatever happens there is a row."""
    begin, folder = time.monotonic(), Path(job.output)
    error = ""
    kept = job.resume and (folder / MARK).is_file() and (folder / "inspection.json").is_file()
    if not kept:
        words = ["inspect", job.source, "--output", job.output, *job.options]
        limits = [str(os.getpid()), str(job.memory_bytes)]
        command = [sys.executable, "-c", _CHILD, *limits, *words]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                errors="backslashreplace",
                timeout=job.timeout_s or None,
            )
        except subprocess.TimeoutExpired:
            return failed(job, f"took longer than {job.timeout_s:g} s", begin)
        if done.returncode not in (0, 3, 4):
            lines = [line for line in done.stderr.splitlines() if line.strip()]
            said = next((line for line in lines if line.startswith("error: ")), lines[-1:] or "")
            # The row names its source already.
            error = str(said if isinstance(said, str) else said[0]).removeprefix("error: ")
            error = _without_name(error, job)
            error = error or f"ended with {done.returncode}"
            if job.memory_bytes and _LACKS_MEMORY.search(error):
                limit_mb = job.memory_bytes // 1_000_000
                error = f"needed more memory than --memory-mb {limit_mb} ({error})"
            if done.returncode != 1 or not (folder / "inspection.json").is_file():
                return failed(job, error, begin)
    try:
        document = json.loads((folder / "inspection.json").read_text())
    except (OSError, ValueError) as fault:
        return failed(job, f"no results: {fault}", begin)
    depths = [f["depth_m"] for f in document["findings"]]
    return Row(
        job.key,
        job.source,
        document["verdict"],
        document["reason"],
        document["coverage"]["measured"],
        len(depths),
        max(depths, key=abs, default=None),
        job.earlier_s if kept else round(time.monotonic() - begin, 2),
        error or "; ".join(_without_name(fault, job) for fault in document["faults"]),
        kept,
    )


def _without_name(error: str, job: Job) -> str:
    """An error without the recording's name, which its row says already."""
    return re.sub(rf"^(bag )?{re.escape(job.source)}: ", "", error)


def failed(job: Job, error: str, begin: float | None = None) -> Row:
    """The row of a job that came to nothing; `begin`: when it began, monotonic time, s."""
    spent = None if begin is None else round(time.monotonic() - begin, 2)
    return Row(job.key, job.source, "", "", None, None, None, spent, error)
