"""Speed against error: files, sections, and what they rest on."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from roller_bringup.cli import main
from roller_core.events import EventArray
from roller_core.output_folder import OutputFolder
from roller_emvs.methods.surface import SurfaceSettings
from roller_emvs.pipeline import DepthPipeline
from roller_evaluation.bench import (
    PAPER,
    Measured,
    front_of,
    measure,
    pareto_front,
    summarise,
    write_bench,
)
from roller_evaluation.bench_plan import BenchOptions, depth_cases
from roller_evaluation.bench_plots import speed_vs_error
from roller_evaluation.cases import Case, ScanCase, depth_settings
from roller_evaluation.dense_reference import dense_reference
from roller_evaluation.figures import ERRORS
from roller_evaluation.measures import MEASURES, measure_depth
from roller_evaluation.pictures import png
from roller_evaluation.scans import Scan, ScanStore
from roller_evaluation.windows import densest_piece, resample, window_pieces

Result = tuple[Path, dict[str, Any]]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory, cell: dict[str, Any]) -> Result:
    folder = tmp_path_factory.mktemp("bench")
    options = BenchOptions.short(
        objects=("stairs",),
        fixed_speed=0.3,
        fixed_events=1500,
        fixed_windows=2,
        scaling_events=(1000, 1500),
        scaling_planes=(20,),
        scaling_threads=(1,),
        cell=cell,
    )
    measured = Measured()
    measure(options, folder / "scans", measured)
    return folder, write_bench(options, measured, folder)


def test_a_quick_run_writes_its_files(bench: Result) -> None:
    folder, _ = bench
    for name in ("speed_vs_error.png", "growth.png"):
        assert (folder / name).stat().st_size > 15_000
    result = json.loads((folder / "bench.json").read_text(), parse_constant=pytest.fail)
    labels = [c["label"] for c in result["cases"]]
    assert {"focus", "surface", "bma", "bma, 500 planes"} < set(labels)
    assert {"focus, printed", "surface, printed"} < set(labels)
    for case in result["cases"]:
        assert case["time"]["windows"] > 0
        for time in ("ms", "ms_per_mev", "cpu_ms"):
            low, middle, high = (case["time"][time + end] for end in ("_low", "", "_high"))
            assert 0 < low <= middle <= high
        assert 0 < case["error"]["mae_um"] < 2000
        assert 0 < case["error"]["edges_measured"] <= 1
        assert set(case["objects"]) == {"stairs"}
        assert {"votes", "other"} < set(case["stages"])
        whole = case["time"]["cpu_ms_per_mev"]
        assert sum(case["stages"].values()) == pytest.approx(whole, rel=0.05, abs=1)
    assert 0 < result["decoding_cpu_ns"] < 1e5
    assert set(result["pareto"]) == {"ms", "ms_per_mev"}
    for front in result["pareto"].values():
        assert front
        assert not any(name.endswith(", printed") for name in front)
        assert set(front) <= set(labels)
    assert not any(name.startswith("surface") for name in result["pareto"]["ms"])
    events = [(r["method"], r["events"]) for r in result["growth"] if r["quantity"] == "events"]
    assert events == [("focus", 1000), ("focus", 1500), ("bma", 1000), ("bma", 1500)]
    fixed = {row["method"]: row for row in result["fixed"]}
    assert list(fixed) == ["focus", "bma", "3 dense volumes of 500 planes"]
    assert fixed["bma"]["windows"] == 2
    assert fixed["bma"]["faster"] > 1
    assert fixed["bma"]["mask_iou"] > 0.2
    text = (folder / "bench.md").read_text()
    assert "| bma" in text
    assert "Fixed case: 1,500 events in 20 ms" in text
    count = len(result["cases"]) + len(result["growth"]) + 3
    assert (folder / "rows.csv").read_text().count("\n") == count + 1


def events_of(n: int) -> EventArray:
    rng = np.random.default_rng(3)
    t = np.sort(rng.integers(0, 10**7, n))
    return EventArray.from_arrays(np.arange(n) % 640, np.arange(n) % 480, t, np.ones(n))


@pytest.mark.parametrize("count", [1, 10, 999, 1000, 1001, 3500])
def test_resampling_keeps_order_and_is_deterministic(count: int) -> None:
    events = events_of(1000)
    drawn = resample(events, count)
    assert len(drawn) == count
    assert np.all(np.diff(drawn.t_ns) >= 0)
    again = resample(events, count)
    for name in ("x", "y", "t_ns", "p"):
        np.testing.assert_array_equal(getattr(drawn, name), getattr(again, name))
    # x and y tell which event it was: in the order that they had.
    number = {(int(x), int(y)): k for k, (x, y) in enumerate(zip(events.x, events.y, strict=True))}
    order = [number[int(x), int(y)] for x, y in zip(drawn.x, drawn.y, strict=True)]
    assert order == sorted(order)
    most = np.bincount(order).max()
    assert most <= -(-count // 1000)
    if 1 < count < 1000:
        other = resample(events, count, seed=1)
        assert not np.array_equal(drawn.x, other.x)


def test_pieces_hold_what_they_should(stairs: Scan) -> None:
    pieces = window_pieces(stairs, 0.02, 0.01, 1500)
    assert pieces
    for piece in [*pieces, densest_piece(stairs, 0.02, 1500)]:
        assert len(piece.events) == 1500
        assert piece.events.t_ns[0] == piece.start_ns
        assert piece.events.t_ns[-1] == piece.end_ns - 1
        assert piece.end_ns - piece.start_ns == 20_000_000
        assert np.all(np.diff(piece.events.t_ns) >= 0)


def test_pareto_front_against_its_definition() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        # Whole numbers: equal coordinates and equal points come up.
        points = [(float(a), float(b)) for a, b in rng.integers(0, 8, (rng.integers(0, 12), 2))]
        slow = [
            k
            for k, p in enumerate(points)
            if not any(q[0] <= p[0] and q[1] <= p[1] and q != p for q in points)
        ]
        front = pareto_front(points)
        assert sorted(front) == slow
        assert [points[k] for k in front] == sorted(points[k] for k in front)


def test_the_front_leaves_out_what_measures_little() -> None:
    def row(label: str, ms: float, error: float, edges: float) -> dict[str, Any]:
        figures = {"near_edge_mae_um": error, "edges_measured": edges}
        return {"label": label, "speed": 0.3, "time": {"ms": ms}, "error": figures}

    rows = [row("few", 1.0, 10.0, 0.1), row("good", 2.0, 50.0, 0.8), row("slow", 3.0, 60.0, 0.9)]
    assert front_of(rows, 0.3, "ms") == ["good"]


def test_blocks_of_the_bare_plate_are_not_timed(stairs: Scan) -> None:
    case = Case(ScanCase("stairs", 0.3), "depth", "surface")
    (row,) = measure_depth(case, stairs)
    (region,) = stairs.truth.objects.values()
    blocks = (region.x1 - region.x0) / SurfaceSettings.create({}).block_m
    # All of the pass is in the time of a million events, so it is more than these blocks took.
    assert row["windows"] > blocks + 1
    assert row["spent_ms"] > row["ms"] * blocks
    assert row["ms_per_mev"] == pytest.approx(row["spent_ms"] / row["events"] * 1e6, rel=1e-3)


def test_cases_are_summed_up_over_objects_and_runs() -> None:
    figures = {"median_um": 1.0, "bias_um": 1.0, "within_100_um": 1.0, "mae_um": 1.0,
               "windows": 2, "refused": 0, "ms_p95": 1.0, "ms_per_mev": 1.0, "cpu_ms": 1.0,
               "cpu_ms_per_mev": 1.0}  # fmt: skip
    about = {"label": "bma", "method": "bma", "factor": "base", "value": "base", "speed": 0.3}
    rows = [
        {**about, **figures, "object": name, "run": run, "ms": ms + run, "points": points,
         "near_edge_mae_um": um, "edges_measured": edges}
        for run in (0, 1, 2)
        for name, ms, points, um, edges in (("a", 1.0, 9, 10.0, 0.5), ("b", 3.0, 1, 30.0, 0.7),
                                            ("c", 2.0, 0, None, 0.0))
    ]  # fmt: skip
    (case,) = summarise(rows)
    assert [case["time"][k] for k in ("ms_low", "ms", "ms_high")] == [2.0, 3.0, 4.0]
    assert (case["time"]["repeats"], case["time"]["windows"]) == (3, 6)
    # An object without any point has no error, and its edges are not measured.
    assert case["error"]["near_edge_mae_um"] == 20.0
    assert case["error"]["objects"] == 2
    assert case["objects"]["b"]["near_edge_mae_um"] == 30.0


def test_the_paper_is_in_the_picture(bench: Result) -> None:
    figure, axis, _ = speed_vs_error(bench[1])
    drawn = [
        tuple(float(v[0]) for v in line.get_data())
        for line in axis.lines
        if len(line.get_xdata()) == 1
    ]
    assert (PAPER["ms"], PAPER["error_um"]) in drawn
    texts = [text.get_text() for text in axis.texts]
    assert any(str(PAPER["label"]) in text for text in texts)
    assert any(text.startswith("focus") for text in texts)
    assert (axis.get_xscale(), axis.get_yscale()) == ("log", "log")
    low, high = axis.get_xlim()
    assert low < PAPER["ms"] < high
    assert png(figure).startswith(b"\x89PNG")


def test_every_case_is_there_once() -> None:
    options = BenchOptions()
    cases = depth_cases(options)
    assert len({case.key for case in cases}) == len(cases)
    for method in options.methods:
        for speed in options.speeds:
            assert any(c.method == method and c.scan.speed == speed for c in cases)
    for case in cases:
        assert case.depth
    assert len(depth_cases(BenchOptions.short())) < len(cases) / 3


def test_the_reference_is_bma_with_every_plane(stairs: Scan) -> None:
    settings = depth_settings(
        "bma",
        **{"window.rule": "all"},
        paper={"threshold_c": 4.0, "plane_rule": "fixed", "planes": 500},
    )
    piece = densest_piece(stairs, 0.02, 3000)
    pipeline = DepthPipeline(settings, stairs.camera, stairs.track)
    pipeline.add_events(piece.events)
    (fast,) = pipeline.results(flush=True)
    plain = dense_reference(piece, settings)
    assert plain.points > 200
    np.testing.assert_array_equal(np.isfinite(fast.depth), np.isfinite(plain.depth))
    np.testing.assert_allclose(fast.depth, plain.depth, atol=2e-6)


def test_wrong_names_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for option, word in (("--objects", "cube"), ("--methods", "magic")):
        assert main(["bench", "--output", str(tmp_path / "out"), option, word]) == 1
        assert option in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def interrupted_after(count: int, monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """Exit code of a benchmark that Ctrl-C meets after so many cases were measured."""
    done = []

    def measure(case: Case, _scan: Scan) -> list[dict[str, Any]]:
        if len(done) == count:
            raise KeyboardInterrupt
        done.append(case)
        figures = dict.fromkeys(("ms", "ms_p95", "ms_per_mev", "cpu_ms", "cpu_ms_per_mev"), 2.5)
        errors = dict.fromkeys(ERRORS, 0.5) | {"near_edge_mae_um": 41.5}
        counts = {"windows": 2, "refused": 0, "spent_ms": 5.0}
        return [{"object": case.scan.scene, **figures, **errors, **counts}]

    monkeypatch.setattr(ScanStore, "get", lambda _store, scan: scan)
    monkeypatch.setattr("roller_evaluation.run.warm_up", lambda _case, _scan: None)
    monkeypatch.setitem(MEASURES, "depth", measure)
    return main(["bench", "--quick", "--objects", "stairs,hexagon", *words])


def test_what_was_measured_before_an_interrupt_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "bench"
    assert interrupted_after(3, monkeypatch, "--output", str(out)) == 130
    said = capsys.readouterr()
    assert "INCOMPLETE" in said.out
    assert "41.5" in said.out
    assert said.err == "interrupted\n"
    assert len((out / "rows.csv").read_text().splitlines()) == 1 + 3
    assert "INCOMPLETE" in (out / "bench.md").read_text()
    result = json.loads((out / "bench.json").read_text())
    assert result["complete"] is False
    # The second method was measured on one object of two: its mean is no match for the first's.
    assert [len(case["objects"]) for case in result["cases"]] == [2, 1]
    assert result["pareto"]["ms_per_mev"] == [result["cases"][0]["label"]]
    assert not list(out.glob("*.png"))

    assert interrupted_after(0, monkeypatch, "--output", str(tmp_path / "none")) == 130
    assert capsys.readouterr() == ("", "interrupted\n")
    assert not (tmp_path / "none" / "rows.csv").exists()


def test_an_interrupt_leaves_a_whole_result_of_an_earlier_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "bench"
    with OutputFolder(out, "bench", lasting=["scans"]) as folder:
        for name in ("rows.csv", "growth.png"):
            (folder.partial / name).write_text("whole")
    assert interrupted_after(2, monkeypatch, "--output", str(out)) == 130
    assert (out / "rows.csv").read_text() == "whole"
    said = capsys.readouterr().out
    assert "41.5" in said
    assert f"stays in {out}" in said


def test_what_was_measured_stays_when_whoever_reads_has_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(_tables: object) -> None:
        assert (tmp_path / "bench" / "rows.csv").exists()
        raise KeyboardInterrupt

    monkeypatch.setattr("roller_evaluation.tables.show_tables", gone)
    assert interrupted_after(3, monkeypatch, "--output", str(tmp_path / "bench")) == 130
    assert (tmp_path / "bench" / "rows.csv").exists()
