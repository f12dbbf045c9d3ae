"""`roller batch`: one failure is a row, what is done stays done."""

import json
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from recording.bags import analytic_dataset, write_bag
from roller_bringup.cli import main
from roller_core import calibration_file
from roller_core.errors import RollerError
from roller_inspect.batch import jobs
from roller_inspect.batch.jobs import find_recordings
from waiting import wait_until

pytestmark = pytest.mark.scan


def test_a_failure_is_a_row_and_what_is_done_stays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # A file's name may hold bytes that are no text.
    folder, out, good = tmp_path / "scans", tmp_path / "out\udcff", "good\udcff"
    write_bag(folder / good)
    (folder / "broken.mcap").write_bytes(b"\x89MCAP0\r\n nothing")
    words = ["batch", str(folder), "--output", str(out), "--method", "focus", "--jobs", "2"]
    assert main(words) == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.count("broken.mcap") == 1

    def rows() -> dict[str, dict[str, object]]:
        found = json.loads((out / "summary.json").read_text())["jobs"]
        return {Path(str(job["source"])).name: job for job in found}

    first = rows()
    assert first[good]["verdict"] == "unmeasured"
    assert first[good]["error"] == ""
    assert first["broken.mcap"]["verdict"] == ""
    done = out / str(first[good]["key"]) / "inspection.json"
    written = done.stat().st_mtime_ns
    page = (out / "index.html").read_text()
    assert f"{first[good]['key']}/inspection.html" in page
    assert len((out / "summary.csv").read_text().splitlines()) == 3

    capsys.readouterr()
    assert main([*words, "--resume"]) == 1
    said = capsys.readouterr().out
    assert f"broken.mcap: tried again, it failed before: {first['broken.mcap']['error']}" in said
    assert rows()[good] == first[good] | {"kept": True}  # and the time that it took then
    assert not rows()["broken.mcap"]["kept"]
    assert done.stat().st_mtime_ns == written


@pytest.mark.parametrize("where", ["golden", "golden/out"])
def test_a_reference_is_an_input_that_results_never_enter(
    where: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    golden, scans = tmp_path / "golden", tmp_path / "scans"
    golden.mkdir()
    (golden / "golden.npz").write_bytes(b"a reference")
    scans.mkdir()
    (scans / "one.mcap").write_text("one")
    words = ["batch", str(scans), "--output", str(tmp_path / where)]
    assert main([*words, "--reference", f"golden:{golden}"]) == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "overlaps with the input" in line
    assert [path.name for path in golden.iterdir()] == ["golden.npz"]


def test_how_far_it_is_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shares: list[float] = []
    bar = contextmanager(lambda _: iter([shares.append]))
    monkeypatch.setattr("roller_core.progress.progress_bar", bar)
    monkeypatch.setattr(jobs, "run_job", lambda job: jobs.failed(job, "not tried", 0.0))
    scans = tmp_path / "scans"
    scans.mkdir()
    for name in ("one", "two"):
        (scans / f"{name}.mcap").write_text(name)
    assert main(["batch", str(scans), "--output", str(tmp_path / "out")]) == 1
    assert shares == [0.5, 1.0]


_BATCH = """
import sys, threading
from roller_inspect.batch import dask_workers, jobs
said = "print(os.getpid(), file=open(sys.argv[2], 'w'))"
jobs._CHILD = f"{jobs._BOUND} import time; {said}; time.sleep(300)"
job = jobs.Job("key", sys.argv[1], "out", (), False, 0.0, 0)
threading.Thread(target=jobs.run_job, args=(job,)).start()
"""


def test_jobs_end_with_a_batch_that_is_killed(tmp_path: Path) -> None:
    """They would hold their output folders, and `--resume` would find another that writes there."""
    file = tmp_path / "pid"
    batch = subprocess.Popen([sys.executable, "-c", _BATCH, str(file)])
    try:
        wait_until(lambda: file.exists() and file.read_text().endswith("\n"), lambda: "no job", 30)
    finally:
        batch.kill()
        batch.wait()
    child = int(file.read_text())
    wait_until(lambda: not is_running(child), lambda: "the job goes on", 10)


def is_running(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except FileNotFoundError:
        return False


def test_recordings_are_found_and_results_are_not(tmp_path: Path) -> None:
    bag, data = write_bag(tmp_path / "bag"), analytic_dataset(tmp_path / "data")
    (tmp_path / "single.raw").touch()
    main(["replay", str(bag), "--output", str(tmp_path / "shown"), "--no-picture", "--no-braille"])
    assert list(find_recordings([tmp_path])) == [bag, data, tmp_path / "single.raw"]


def test_files_of_events_alone_are_found_with_the_poses_beside_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scans, taken = tmp_path / "scans", []
    scans.mkdir()
    for name in ("a.aedat4", "b.h5", "c.RAW", "d.HDF5", "e.txt", "b.poses.txt", "e.poses.txt"):
        (scans / name).write_text(name)

    def noted(job: jobs.Job) -> jobs.Row:
        taken.append(job)
        return jobs.Row(job.key, job.source, "", "", None, None, None, None, "noted")

    monkeypatch.setattr(jobs, "run_job", noted)
    words = ["batch", str(scans), "--output", str(tmp_path / "out")]
    assert main(words) == 1
    poses = {Path(job.source).name: job.options[-2:] for job in taken}
    assert sorted(poses) == ["a.aedat4", "b.h5", "c.RAW", "d.HDF5"]
    assert poses.pop("b.h5") == ("--poses", str(scans / "b.poses.txt"))
    assert not any("--poses" in options for options in poses.values())
    (scans / "b.poses.txt").write_text("other poses")
    main(words)
    keys = [job.key for job in taken]
    assert len(set(keys)) == 5  # with other poses it is another job


def test_links_to_recordings_are_followed_once(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "elsewhere" / "bag")
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "a").symlink_to(bag)
    (folder / "b").symlink_to(tmp_path / "elsewhere")
    (folder / "c").symlink_to(folder)
    (folder / "gone").symlink_to(tmp_path / "nowhere")
    assert list(find_recordings([folder])) == [folder / "a"]


@pytest.mark.parametrize("option", ["--reference", "--camera"])
def test_a_file_that_holds_something_else_now_makes_another_job(
    option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, scans, out = (tmp_path / name for name in ("part.stl", "scans", "out"))
    scans.mkdir()
    (scans / "one.mcap").touch()
    tried: list[jobs.Job] = []
    monkeypatch.setattr(
        jobs, "run_job", lambda job: tried.append(job) or jobs.failed(job, "not tried", 0.0)
    )
    value = f"cad:{file}" if option == "--reference" else str(file)
    for height_m in (0.0, 1e-3):
        corners = [[0, 0, height_m], [0.05, 0, height_m], [0, 0.05, height_m]]
        facet = "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners)
        file.write_text(f"solid a\nfacet normal 0 0 1\nouter loop\n{facet}endloop\nendfacet\n")
        words = ["batch", str(scans), "--output", str(out), "--resume", option, value]
        main([*words, "--topic", "left/events"])
    first, second = tried
    assert first.key != second.key
    assert " ".join(first.options).count(f"{option} {value}") == 1
    assert "--topic left/events" in " ".join(first.options)


def test_a_recording_that_is_there_twice_is_named_and_inspected_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tried: list[jobs.Job] = []
    monkeypatch.setattr(
        jobs, "run_job", lambda job: tried.append(job) or jobs.failed(job, "not tried", 0.0)
    )
    scans = tmp_path / "scans"
    for name in ("one", "sub/two", "three"):
        (scans / name).parent.mkdir(parents=True, exist_ok=True)
        (scans / f"{name}.mcap").write_text("alike" if name != "three" else "another")
    main(["batch", str(scans), "--output", str(tmp_path / "out")])
    first, _ = (job.source for job in tried)
    said = capsys.readouterr().out
    assert f"{scans}/sub/two.mcap: the same recording as {first}; inspected once" in said


@pytest.mark.parametrize("words", [["replay", "", "-o", "out"], ["inspect", "scan", "-o", ""]])
def test_an_empty_name_is_wrong_usage(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(words)
    assert end.value.code == 2
    assert "the name is empty" in capsys.readouterr().err


def test_no_recordings_is_wrong_usage(tmp_path: Path) -> None:
    assert main(["batch", str(tmp_path), "--output", str(tmp_path.parent / "out")]) == 2


@pytest.mark.parametrize(
    "words",
    ["--jobs 0", "--jobs -5", "--jobs 1e9", "--timeout-s nan", "--timeout-s 1e300", "--timeout-s x",
     "--memory-mb -4", "--memory-mb 200", "--memory-mb 900", "--memory-mb 18446744073709551616"],
)  # fmt: skip
def test_numbers_out_of_range_are_wrong_usage(
    words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, value = words.split()
    with pytest.raises(SystemExit) as end:
        main(["batch", str(tmp_path), "--output", str(tmp_path.parent / "out"), name, value])
    assert end.value.code == 2
    assert f"'{value}' is not a" in capsys.readouterr().err


def test_folders_that_are_none_are_wrong_usage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A misspelt one among others would cost its recordings without a word."""
    (scans := tmp_path / "scans").mkdir()
    (file := scans / "a.mcap").write_text("a")
    for wrong, says in ((tmp_path / "scnas", "is not there"), (file, "is a file; name the folder")):
        words = ["batch", str(scans), str(wrong), "--output", str(tmp_path / "out")]
        assert main(words) == 2
        assert capsys.readouterr().err.startswith(f"error: {wrong}: {says}")
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_read_costs_itself_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("closed/one", "open/secret", "open/two"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / f"{name}.mcap").write_text(name)
    (tmp_path / "empty").mkdir()
    closed, walked = str(tmp_path / "closed"), os.scandir

    def scandir(path: Any) -> Any:  # permissions don't hold whoever is root
        if os.fspath(path) == closed:
            raise PermissionError(13, "Permission denied", closed)
        return walked(path)

    def digest(path: Path) -> str:
        if path.stem == "secret":
            raise RollerError(f"{path}: can't be read (Permission denied)")
        return path.stem

    tried: list[jobs.Job] = []
    monkeypatch.setattr(os, "scandir", scandir)
    monkeypatch.setattr(calibration_file, "digest", digest)
    monkeypatch.setattr(
        jobs, "run_job", lambda job: tried.append(job) or jobs.failed(job, "not tried", 0.0)
    )
    folders = [str(tmp_path / name) for name in ("closed", "open", "empty")]
    assert main(["batch", *folders, "--output", str(tmp_path / "out")]) == 1
    assert sorted(Path(job.source).name for job in tried) == ["secret.mcap", "two.mcap"]
    said = capsys.readouterr().err
    assert f"warning: {closed}: can't be read (Permission denied)" in said
    assert f"warning: {tmp_path / 'empty'}: no recordings there" in said


def test_a_job_that_lacks_memory_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    job = jobs.Job("k", "scan", str(tmp_path / "out"), (), False, 0.0, 600_000_000)
    code = (
        'import sys; print("RuntimeError: can\'t start new thread", file=sys.stderr); sys.exit(1)'
    )
    monkeypatch.setattr(jobs, "_CHILD", code)
    row = jobs.run_job(job)
    assert row.error == (
        "needed more memory than --memory-mb 600 (RuntimeError: can't start new thread)"
    )
