"""Cases in, rows out: over all cores and kept on disk, or timed one at a time."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from joblib import Memory, Parallel, delayed

from roller_core.digests import source_digest
from roller_core.library_threads import one_thread_a_library
from roller_core.progress import OnProgress, no_progress

from .cases import Case
from .measures import MEASURES, TIMED, TIMES, warm_up
from .rows import Row
from .scans import ScanStore

#: All whose source decides what a case's rows say.
_PACKAGES = (
    "roller_core", "roller_sim", "roller_emvs", "roller_braille", "roller_inspect",
    "roller_calibration", "roller_evaluation",
)  # fmt: skip


def run(
    cases: Sequence[Case], folder: Path, *, jobs: int = 1, on_progress: OnProgress = no_progress
) -> list[Row]:
    """Measure cases, or take what an earlier run left of the same.

    Parameters
    ----------
    cases : sequence of Case
        In the order of the rows.
    folder : path
        Where each case's rows are kept, so that a run that was broken off goes on.
    jobs : int
        Processes; with one it is this process.
    on_progress : callable
        Takes what was done and the share done, 0–1.

    Returns
    -------
    list of dict
        The cases' columns and their figures, without times.

    Raises
    ------
    RollerError
        If a case's settings are no good.
    """
    one_thread_a_library()
    # A worker that holds much memory is put in the place of another: that is no fault.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
    kept = Memory(folder, verbose=0).cache(_rows, ignore=["case", "scans"])
    source = source_digest(*_PACKAGES)
    missing: dict[str, list[Case]] = {}
    for case in {c.key: c for c in cases}.values():
        if not kept.check_call_in_cache(case.key, source, case, None):
            missing.setdefault(case.scan.key, []).append(case)
    # The longest first, so that no core waits for one at the end.
    groups = sorted(missing.values(), key=lambda group: group[0].scan.speed)
    threads = 1 if min(jobs, len(groups)) > 1 else 0
    work = Parallel(n_jobs=max(min(jobs, len(groups)), 1), return_as="generator_unordered")
    for done, name in enumerate(
        work(delayed(_measure_scan)(kept, source, group, threads) for group in groups), 1
    ):
        on_progress(name, done / len(groups))
    return [{**case.columns, **row} for case in cases for row in kept(case.key, source, case, None)]


def _measure_scan(kept: Any, source: str, cases: Sequence[Case], threads: int) -> str:
    """Measure all cases of one scan, which is simulated once."""
    scans = ScanStore(threads=threads)
    for case in cases:
        kept(case.key, source, case, scans)
    scan = cases[0].scan
    return f"{scan.scene} at {scan.speed:g} m/s"


def _rows(_key: str, _source: str, case: Case, scans: ScanStore | None) -> list[Row]:
    found = MEASURES[case.measure](case, (scans or ScanStore()).get(case.scan))
    drop = TIMES if case.measure in TIMED else ()
    return [{k: v for k, v in row.items() if k not in drop} for row in found]


def run_timed(
    cases: Sequence[Case],
    scans: ScanStore,
    repeats: int,
    budget_s: float = float("inf"),
    on_progress: OnProgress = no_progress,
    rows: list[Row] | None = None,
) -> list[Row]:
    """Measure cases with their times, one after the other in this process.

    All cases are run once, then all of them again, and so on: what else the machine does
    meanwhile falls on all cases alike, and shows as their spread. Before its first round a case is
    run without a clock: what one object needs compiled another may not.

    Parameters
    ----------
    cases : sequence of Case
        The cases.
    scans : ScanStore
        Where their scans come from.
    repeats : int
        Rounds; each gives a row a case, with its number as `run`.
    budget_s : float
        A case that has taken longer stays out of further rounds.
    on_progress : callable
        Takes what is being done and the share done, 0–1.
    rows : list of dict, optional
        Takes the rows as they come, so that an interrupt leaves them.
    """
    one_thread_a_library()
    spent_ms = [0.0] * len(cases)
    rows = [] if rows is None else rows
    for number in range(repeats):
        for k, case in enumerate(cases):
            if spent_ms[k] > 1e3 * budget_s:
                continue
            on_progress(f"{case.method}, {case.scan.scene}", (number + k / len(cases)) / repeats)
            scan = scans.get(case.scan)
            if number == 0:
                warm_up(case, scan)
            found = MEASURES[case.measure](case, scan)
            spent_ms[k] += sum(row.get("spent_ms", 0.0) for row in found)
            rows += [{**case.columns, "run": number, **row} for row in found]
    return rows
