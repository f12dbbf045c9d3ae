"""Speed against error: files, sections, and what they rest on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.text import Text

from roller_bringup.cli import main
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_emvs.methods.surface import SurfaceSettings
from roller_emvs.pipeline import DepthPipeline
from roller_evaluation.bench.cases import Case, depth_settings, plan
from roller_evaluation.bench.measure import CaseRun
from roller_evaluation.bench.options import BenchOptions
from roller_evaluation.bench.pareto import pareto_front
from roller_evaluation.bench.plots import speed_vs_error
from roller_evaluation.bench.reference import dense_reference
from roller_evaluation.bench.resampling import densest_piece, resample, scaled, window_pieces
from roller_evaluation.bench.run import PAPER, front_of, run_bench
from roller_evaluation.bench.scans import CROSSING_M, Scan, get_scan
from roller_evaluation.bench.slider import run_slider

#: A small image and a short hold: few events, and the same plate.
CELL = {
    "camera": {"width": 320, "height": 240, "focal_px": 533.0},
    "scene": {"step_mm": 0.05},
    "motion": {"hold_s": 0.02},
}
OPTIONS = BenchOptions.short(
    objects=("stairs",),
    fixed_events=3000,
    fixed_windows=2,
    growth_events=(1000, 3000),
    growth_planes=(20,),
    growth_scales=(1.0, 2.0),
    growth_threads=(1,),
    cell=CELL,
)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("bench")
    return folder, run_bench(OPTIONS, folder)


@pytest.fixture(scope="module")
def scan(bench: tuple[Path, dict[str, Any]]) -> Scan:
    return get_scan(bench[0] / "scans", "stairs", 0.3, CELL)


def test_a_quick_run_writes_its_files(bench: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = bench
    for name in ("speed_vs_error.png", "growth.png"):
        assert (folder / name).stat().st_size > 15_000
    result = json.loads((folder / "bench.json").read_text(), parse_constant=pytest.fail)
    assert {"machine", "cases", "pareto", "savings", "growth", "fixed", "paper"} <= set(result)
    labels = [c["label"] for c in result["cases"]]
    assert {"focus", "bma", "surface", "focus, no edge drift correction"} < set(labels)
    assert "surface, no edge drift correction" in labels
    for case in result["cases"]:
        assert case["time"]["windows"] > 0
        for time in ("ms", "ms_per_mev"):
            low, middle, high = (case["time"][time + end] for end in ("_low", "", "_high"))
            assert 0 < low <= middle <= high
        assert 0 < case["error"]["mae_um"] < 2000
        assert 0 < case["error"]["edges_measured"] <= 1
        assert set(case["objects"]) == {"stairs"}
    assert set(result["pareto"]) == {"ms", "ms_per_mev"}
    for front in result["pareto"].values():
        assert front
        assert set(front) <= set(labels)
    assert not any(name.startswith("surface") for name in result["pareto"]["ms"])
    for row in result["savings"]:
        assert row["times_faster"] > 0
    events = [(r["method"], r["events"]) for r in result["growth"]["events"]]
    assert events == [("focus", 1000), ("focus", 3000), ("bma", 1000), ("bma", 3000)]
    assert [r["image"] for r in result["growth"]["image"][:2]] == [[320, 240], [640, 480]]
    fixed = result["fixed"]
    assert fixed["windows"] >= 2
    assert set(fixed["methods"]) == {"focus", "bma"}
    assert fixed["methods"]["bma"]["ratio"] > 0
    assert fixed["bma_from_reference"]["mask_iou"] > 0.2
    text = (folder / "bench.md").read_text()
    assert "| bma" in text
    assert "Fixed case: 3,000 events in 20 ms" in text


def test_scans_are_kept_and_made_anew_for_other_settings(tmp_path: Path) -> None:
    small = {**CELL, "camera": {"width": 40, "height": 30, "focal_px": 66.6}}
    first = get_scan(tmp_path, "stairs", 0.5, small)
    asked = tmp_path / "stairs_0.5" / "asked.yaml"
    written = asked.stat().st_mtime_ns
    again = get_scan(tmp_path, "stairs", 0.5, small)
    assert asked.stat().st_mtime_ns == written
    np.testing.assert_array_equal(first.events.t_ns, again.events.t_ns)
    get_scan(tmp_path, "stairs", 0.5, {**small, "sensor": {"hot_hz": 1.0}})
    assert asked.stat().st_mtime_ns > written


def test_a_crossing_is_as_long_as_it_says(scan: Scan) -> None:
    crossing = scan.crossing()
    x = scan.truth.camera_positions(crossing.t_ns[[0, -1]])[:, 0]
    assert abs(x[1] - x[0] - CROSSING_M) < 2e-4
    region = scan.truth.objects["stairs"]
    assert abs(x.mean() - 0.5 * (region.x0 + region.x1)) < 2e-4


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


def test_pieces_hold_what_they_should(scan: Scan) -> None:
    pieces = window_pieces(scan, 0.02, 0.01, 2000)
    assert pieces
    for piece in [*pieces, densest_piece(scan, 0.02, 2000)]:
        assert len(piece.events) == 2000
        assert piece.events.t_ns[0] == piece.start_ns
        assert piece.events.t_ns[-1] == piece.end_ns - 1
        assert piece.end_ns - piece.start_ns == 20_000_000
        assert np.all(np.diff(piece.events.t_ns) >= 0)


def test_a_larger_image_sees_the_same_rays() -> None:
    camera = Camera(160, 120, 266.5, 266.5, 79.5, 59.5)
    events = EventArray.from_arrays([0, 80, 159], [0, 60, 119], [1, 2, 3], [1, 0, 1])
    for scale in (0.5, 2.0, 4.0):
        moved, other = scaled(events, camera, scale)
        assert (other.width, other.height) == (160 * scale, 120 * scale)
        assert moved.x.max() < other.width
        assert moved.y.max() < other.height
        ray = (moved.x - other.cx) / other.fx
        np.testing.assert_allclose(ray, (events.x - 79.5) / 266.5, atol=1.5 / other.fx + 1 / 266.5)


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


def test_blocks_of_the_bare_plate_are_not_timed(scan: Scan) -> None:
    run = CaseRun(Case("surface", "base", "base", 0.3, {}), [scan])
    run.go()
    run.go()
    times = run.figures()["time"]
    (region,) = scan.truth.objects.values()
    blocks = (region.x1 - region.x0) / SurfaceSettings.create({}).block_m
    assert times["repeats"] == 2
    assert 2 * blocks <= times["windows"] <= 2 * (blocks + 2)
    # All of the pass is in the time of a million events, so it is more than these blocks took.
    of_blocks = times["ms_low"] * times["windows"] / len(scan.events) * 1e6
    assert times["ms_per_mev"] > 0.3 * of_blocks


def test_names_in_the_figure_lie_beside_each_other(bench: tuple[Path, dict[str, Any]]) -> None:
    figure, *axes = speed_vs_error(bench[1])
    figure.canvas.draw()
    for axis in axes:
        inside = axis.get_window_extent()
        boxes = [Text.get_window_extent(text) for text in axis.texts]
        assert len(boxes) >= 3
        for k, box in enumerate(boxes):
            assert inside.x0 <= box.x0 < box.x1 <= inside.x1
            assert not any(box.overlaps(other) for other in boxes[:k])
    plt.close(figure)


def test_the_paper_is_in_the_figure(bench: tuple[Path, dict[str, Any]]) -> None:
    figure, axis, _ = speed_vs_error(bench[1])
    drawn = [
        tuple(float(v[0]) for v in line.get_data())
        for line in axis.lines
        if len(line.get_xdata()) == 1
    ]
    assert (PAPER["ms"], PAPER["error_um"]) in drawn
    texts = [text.get_text() for text in axis.texts]
    assert any(str(PAPER["label"]) in text for text in texts)
    assert (axis.get_xscale(), axis.get_yscale()) == ("log", "log")
    low, high = axis.get_xlim()
    assert low < PAPER["ms"] < high
    plt.close(figure)


def test_every_case_is_there_once() -> None:
    cases = plan(BenchOptions())
    keys = [case.key for case in cases]
    assert len(set(keys)) == len(keys)
    for method in BenchOptions().methods:
        assert Case(method, "base", "base", 0.3, {}) in cases
        assert any(c.method == method and c.speed == 0.5 for c in cases)
    assert len(plan(BenchOptions.short())) < len(cases)


def test_the_reference_is_bma_with_every_plane(scan: Scan) -> None:
    settings = depth_settings(
        "bma",
        **{"window.rule": "all"},
        paper={"threshold_c": 4.0, "plane_rule": "fixed", "planes": 500},
    )
    piece = densest_piece(scan, 0.02, 5000)
    pipeline = DepthPipeline(settings, scan.camera, scan.track)
    pipeline.add_events(piece.events)
    (fast,) = pipeline.results(flush=True)
    plain = dense_reference(piece, settings)
    assert plain.points > 300
    np.testing.assert_array_equal(np.isfinite(fast.depth), np.isfinite(plain.depth))
    np.testing.assert_allclose(fast.depth, plain.depth, atol=2e-6)


def test_wrong_names_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for option, word in (("--objects", "cube"), ("--methods", "magic"), ("--repeats", "0")):
        assert main(["bench", "--output", str(tmp_path / "out"), option, word]) == 1
        assert option in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.recordings
def test_slider_depth_gives_events_a_second(shared_data: Path) -> None:
    found = run_slider(shared_data / "slider_depth", 1)
    assert found["events"] > 1_000_000
    assert [row["threads"] for row in found["threads"]] == [1, 2]
    for row in found["threads"]:
        assert row["votes_mev_s"] >= row["depth_map_mev_s"] > 0
        assert 2300 < row["points"] < 3200
