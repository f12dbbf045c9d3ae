"""The harness: scans that are kept, rows that are kept, one process and two."""

import csv
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from roller_core.digests import source_digest
from roller_core.errors import SettingsError
from roller_evaluation import measures
from roller_evaluation import run as running
from roller_evaluation import scans as scanning
from roller_evaluation.cases import METHODS, Case, ScanCase
from roller_evaluation.measures import TIMES
from roller_evaluation.rows import deviation, mean, where, write_rows
from roller_evaluation.run import run, run_timed
from roller_evaluation.scans import CROSSING_M, Scan, ScanStore

SMALL = {"camera": {"width": 40, "height": 30, "focal_px": 66.6}, "scene": {"step_mm": 0.08}}


@pytest.fixture
def cases(cell: dict[str, Any]) -> list[Case]:
    scans = [ScanCase("stairs", speed, cell=cell) for speed in (0.3, 0.5)]
    return [Case(s, "depth", m, labels={"label": m}) for s in scans for m in ("bma", "surface")]


def never(*_: object, **__: object) -> None:
    raise AssertionError("measured again")


def test_cases_differ_by_what_changes_their_figures() -> None:
    scan = ScanCase("stairs", 0.3)
    case = Case(scan, "depth", "bma")
    others = [
        replace(case, scan=scan.changed(skin={"contact": "light"})),
        replace(case, scan=replace(scan, seed=2)),
        replace(case, method="focus"),
        replace(case, measure="plate"),
        replace(case, settings={"paper.median_px": 5}),
    ]
    assert len({c.key for c in [case, *others]}) == 6
    assert replace(case, labels={"value": "base"}).key == case.key
    # What is the default anyhow is no other scan.
    assert scan.changed(skin={"contact": "full"}).key == scan.key
    assert len({case, replace(case)}) == 1
    for name in METHODS:
        assert replace(case, method=name).depth
    with pytest.raises(SettingsError, match="median"):
        _ = replace(case, settings={"paper.median_px": -1}).depth


def test_source_digests_differ_by_package() -> None:
    assert source_digest("roller_core") != source_digest("roller_core", "roller_sim")


def test_scans_are_kept_and_made_again_for_other_settings_or_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = ScanCase("stairs", 0.5, cell=SMALL)
    first = ScanStore(tmp_path).get(case)
    with monkeypatch.context() as patched:
        patched.setattr(scanning, "simulate", never)
        store = ScanStore(tmp_path)
        again = store.get(case)
        assert store.get(case) is again
        for other in (replace(case, seed=2), case.changed(sensor={"threshold": 0.3})):
            with pytest.raises(AssertionError, match="measured again"):
                store.get(other)
        patched.setattr(scanning, "source_digest", lambda *_: "another")
        with pytest.raises(AssertionError, match="measured again"):
            ScanStore(tmp_path).get(case)
    np.testing.assert_array_equal(first.events.t_ns, again.events.t_ns)
    np.testing.assert_array_equal(first.track.positions, again.track.positions)


def test_a_scan_is_its_packets_and_its_crossing(stairs: Scan) -> None:
    assert sum(map(len, stairs.packets)) == len(stairs.events)
    np.testing.assert_array_equal(stairs.packets[-1].t_ns[-1], stairs.events.t_ns[-1])
    x = stairs.truth.camera_positions(stairs.crossing.t_ns[[0, -1]])[:, 0]
    assert abs(x[1] - x[0] - CROSSING_M) < 2e-4
    region = stairs.truth.objects["stairs"]
    assert abs(x.mean() - 0.5 * (region.x0 + region.x1)) < 2e-4


def test_a_run_that_was_broken_off_goes_on(
    cases: list[Case], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reported: list[str] = []
    found = run(cases, tmp_path, on_progress=lambda text, _: reported.append(text))
    assert reported == ["stairs at 0.3 m/s", "stairs at 0.5 m/s"]
    assert [(r["method"], r["speed"]) for r in found] == [
        (c.method, c.scan.speed) for c in cases
    ]  # fmt: skip
    for row in found:
        assert 0 < row["mae_um"] < 400
        assert 0.2 < row["edges_measured"] <= 1.0
        assert not set(row) & set(TIMES)
    monkeypatch.setitem(measures.MEASURES, "depth", never)
    assert run(cases, tmp_path) == found
    # Labels are columns and nothing else.
    relabelled = run([replace(cases[0], labels={"label": "x"})], tmp_path)
    assert relabelled == [{**found[0], "label": "x"}]
    # Other settings, other source and a file that was cut off are measured again.
    again = [replace(cases[0], settings={"paper.median_px": 5})]
    with pytest.raises(AssertionError, match="measured again"):
        run(again, tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(running, "source_digest", lambda *_: "another")
        with pytest.raises(AssertionError, match="measured again"):
            run(cases[:1], tmp_path)
    for file in tmp_path.rglob("output.pkl"):
        file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(AssertionError, match="measured again"):
        run(cases, tmp_path)


def test_processes_find_what_one_finds(cell: dict[str, Any], tmp_path: Path) -> None:
    scans = [ScanCase("stairs", speed, cell=cell | SMALL) for speed in (0.3, 0.5)]
    cases = [Case(scan, "depth", "surface") for scan in scans]
    assert run(cases, tmp_path / "two", jobs=2) == run(cases, tmp_path / "one")


def test_timed_cases_have_times_of_every_round(cases: list[Case]) -> None:
    store = ScanStore(hold=2)
    rows = run_timed(cases[:2], store, 2)
    assert [(r["method"], r["run"]) for r in rows] == [
        ("bma", 0), ("surface", 0), ("bma", 1), ("surface", 1),
    ]  # fmt: skip
    for row in rows:
        assert 0 < row["ms"] <= row["ms_p95"] <= row["spent_ms"]
        assert row["ms_per_mev"] > 0
        assert row["cpu_ms"] > 0
        assert row["mae_um"] == where(rows, method=row["method"])[0]["mae_um"]
    assert len(run_timed(cases[:1], store, 3, budget_s=0.0)) == 1


def test_every_case_is_run_once_and_whole_before_its_clock(
    cell: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What one object needs compiled another may not, nor the first block what the others need."""
    taken: list[tuple[str, str]] = []
    made = measures.results_of

    def watched(settings: Any, scan: Any, events: Any) -> Any:
        yield from made(settings, scan, events)
        taken.append((sys._getframe(1).f_code.co_name, scan.name))

    monkeypatch.setattr(measures, "results_of", watched)
    scans = [ScanCase(name, 0.5, cell=cell | SMALL) for name in ("stairs", "hexagon")]
    run_timed([Case(scan, "depth", "surface") for scan in scans], ScanStore(hold=2), 2)
    names = [name for by, name in taken if by == "warm_up"]
    assert names == ["stairs", "hexagon"]
    assert [by for by, _ in taken].index("warm_up") == 0
    assert len(taken) == 2 + 4


def test_rows_are_summed_up_and_written(tmp_path: Path) -> None:
    rows = [{"a": 1, "b": 2.0}, {"a": 1, "b": None}, {"a": 2, "b": 4.0, "c": "x"}]
    assert where(rows, a=1) == rows[:2]
    assert (mean(rows, "b"), mean(rows[1:2], "b")) == (3.0, None)
    assert deviation(rows, "b") == pytest.approx(2**0.5)
    assert deviation(rows[:2], "b") is None
    write_rows(rows, tmp_path / "rows.csv")
    with (tmp_path / "rows.csv").open() as file:
        assert list(csv.DictReader(file))[2] == {"a": "2", "b": "4.0", "c": "x"}
