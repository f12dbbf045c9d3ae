"""`roller batch` with a scheduler of Dask."""

import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from roller_bringup.cli import main
from roller_inspect.batch import dask_workers, jobs

pytestmark = pytest.mark.scan


@pytest.fixture
def cluster() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=0, threads_per_worker=1, processes=True, protocol="tcp://", host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
    ) as made:  # fmt: skip
        yield made


def batch(folder: Path, out: Path, *words: str) -> tuple[int, list[dict[str, Any]]]:
    """Exit code, and the rows of the summary."""
    code = main(["batch", str(folder), "--output", str(out), "--method", "focus", *words])
    summary = out / "summary.json"
    return code, json.loads(summary.read_text())["jobs"] if summary.exists() else []


def broken_scans(folder: Path, count: int) -> Path:
    folder.mkdir()
    for k in range(count):
        (folder / f"broken{k}.mcap").write_bytes(b"\x89MCAP0\r\n nothing" + bytes([k]))
    return folder


def test_a_dask_scheduler_does_the_jobs(cluster: Any, tmp_path: Path) -> None:
    cluster.scale(2)
    folder = broken_scans(tmp_path / "scans", 3)
    code, rows = batch(folder, tmp_path / "out", "--scheduler", cluster.scheduler_address)
    assert code == 1
    assert [Path(row["source"]).name for row in rows] == [f"broken{k}.mcap" for k in range(3)]
    assert all("nothing is read" in row["error"] for row in rows)


def test_what_a_scheduler_lacks_is_said(
    cluster: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = broken_scans(tmp_path / "scans", 1)
    words = ("--scheduler", cluster.scheduler_address)
    monkeypatch.setattr(dask_workers, "_PATIENCE_S", 2)
    assert batch(folder, tmp_path / "out", *words) == (1, [])
    assert "the scheduler has no workers; start some" in capsys.readouterr().err
    cluster.scale(1)
    monkeypatch.setattr(dask_workers, "_KNOWS_US", "False")
    assert batch(folder, tmp_path / "out", *words) == (1, [])
    assert re.search(r"the worker tcp://\S+ has no roller_inspect", capsys.readouterr().err)


def test_a_job_that_kills_its_worker_costs_itself_alone(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster.scale(2)  # each has one of them
    cluster.wait_for_workers(2)
    cluster.scheduler.allowed_failures = 1
    job, other = (jobs.Job(key, key, "out", (), False, 0.0, 0) for key in ("dies", "lives"))
    cloudpickle = pytest.importorskip("cloudpickle")
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    monkeypatch.setattr(jobs, "run_job", dies_or_lives)
    rows = {
        row.key: row
        for row in dask_workers.rows_of_workers([job, other], cluster.scheduler_address)
    }
    assert rows["dies"].error.startswith("its worker gave it up: ")
    assert rows["lives"].verdict == "conform"


def dies_or_lives(job: jobs.Job) -> jobs.Row:
    """On a worker, which knows nothing of this file: it is sent there as it stands."""
    from dataclasses import replace

    from roller_inspect.batch.jobs import failed

    if job.key == "dies":
        os._exit(1)
    return replace(failed(job, ""), verdict="conform")
