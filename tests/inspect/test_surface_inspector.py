"""Height map and findings of analytic surfaces."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from roller_emvs.patch import Patch
from roller_inspect import surface_inspector
from roller_inspect.findings.cues import height_cue
from roller_inspect.findings.dense_edges import usual_density
from roller_inspect.findings.finder_settings import FindingSettings
from roller_inspect.findings.smoothing import (
    between_blocks,
    block_means,
    cell_weights,
    smoothed,
    smoothed_sums,
    weighted,
)
from roller_inspect.height_map import CONTINUED, MEASURED, OUTSIDE, HeightMap, HeightMapError
from roller_inspect.height_map.height_map import centres
from roller_inspect.height_map.join import coarser
from roller_inspect.pieces import Found, Piece
from roller_inspect.references import NominalReference
from roller_inspect.surface_inspector import InspectionSettings, SurfaceInspector

from .analytic_surface import dent, flat, scan


def inspect(patches: list[Patch], **settings: object) -> Found:
    inspector = SurfaceInspector(InspectionSettings.create(settings), NominalReference("plane"))
    for patch in patches:
        inspector.add(patch)
    return inspector.finish()


def test_a_point_that_is_nowhere_takes_nothing_with_it() -> None:
    """The first ones tell the map's frame."""
    patches = list(scan(flat))
    whole = inspect(patches).height_map
    points = patches[0].points.copy()
    points[0] = np.nan
    lacking = inspect([replace(patches[0], points=points), *patches[1:]]).height_map
    assert whole is not None
    assert lacking is not None
    assert (lacking.state == MEASURED).sum() >= (whole.state == MEASURED).sum() - 1
    nowhere = replace(patches[0], points=np.full_like(points, np.nan))
    assert inspect([nowhere]).height_map is None


def test_a_clean_plane_has_no_findings_and_a_dent_has_its_figures() -> None:
    assert inspect(scan(flat)).findings == ()
    found = inspect(scan(dent((0.015, 0.001), 1.5e-3, 2e-4)))
    (finding,) = found.findings
    assert finding.kind == "dent"
    assert finding.final
    np.testing.assert_allclose(finding.center_m, [0.015, 0.001, -1e-4], atol=2e-4)
    assert abs(finding.depth_m + 2e-4) < finding.uncertainty.depth_m
    assert finding.uncertainty.depth_m < 1e-4
    # (1 - r²)² reaches the outline's part of the depth at 0.74 of the radius.
    assert finding.length_m == pytest.approx(2 * 0.74 * 1.5e-3, rel=0.2)
    assert finding.volume_m3 == pytest.approx(-np.pi / 3 * 1.5e-3**2 * 2e-4, rel=0.2)


def test_noise_grows_with_what_points_claim_towards_the_ends_of_a_scan() -> None:
    def less_seen(patch: Patch) -> Patch:
        times = 1 + 5 * np.clip((np.abs(patch.points[:, 0] - 0.02) - 0.014) / 6e-3, 0, 1)
        points = np.column_stack([patch.points[:, :2], patch.points[:, 2] * times])
        return replace(patch, points=points, sigma=patch.sigma * times.astype(np.float32))

    inspector = SurfaceInspector(InspectionSettings.create({}), NominalReference("plane"))
    for patch in scan(flat, length_m=0.04, width_m=0.02):
        inspector.add(less_seen(patch))
    found = inspector.finish()
    assert found.findings == ()
    height_map = found.height_map
    assert height_map is not None
    comparison = NominalReference("plane").compare(height_map, None)
    cues = height_cue(height_map, comparison, FindingSettings.create({}))
    fine, _ = smoothed(comparison.deviation_m, cell_weights(height_map, comparison.deviation_m), 1)
    for end_m in (0.0055, 0.02, 0.0345):
        there = np.abs(height_map.x_m - end_m) < 1e-3
        here = np.ix_(np.abs(height_map.y_m) < 7e-3, there)
        errs = 1.4826 * np.nanmedian(np.abs(fine[here]))
        assert np.median(cues.noise_around_m[0][here]) == pytest.approx(errs, rel=0.4)


def test_what_few_points_tell_must_differ_the_more() -> None:
    def found(height_m: float) -> Found:
        return inspect(scan(dent((0.015, 0.001), 5e-4, -height_m), seed=2))

    low, high = found(9e-5), found(1.6e-4)
    assert low.findings == ()
    (finding,) = high.findings
    assert finding.points < 100
    assert 0.45 < finding.confidence < 0.75


def test_a_small_dent_beside_a_deep_one_is_a_finding_of_its_own_and_its_foot_is_none() -> None:
    deep, small = dent((0.013, 0.0), 1.5e-3, 4e-4), dent((0.0165, 0.001), 1.5e-3, 1.2e-4)
    found = inspect(scan(lambda x, y: deep(x, y) + small(x, y)))
    depths = [f.depth_m for f in sorted(found.findings, key=lambda f: f.depth_m)]
    np.testing.assert_allclose(depths, [-4e-4, -1.2e-4], atol=4e-5)


def test_a_raised_edge_all_around_makes_a_crater_and_no_finding_of_its_own() -> None:
    hollow, bump = dent((0.014, 0.0), 1.3e-3, 2e-4), dent((0.0165, 0.0), 1e-3, -1e-4)

    def rim(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        away = np.abs(np.hypot(x - 0.014, y) - 1.6e-3) / 4e-4
        return np.where(away < 1, 6e-5 * (1 - away**2) ** 2, 0.0)

    (crater,) = inspect(scan(lambda x, y: hollow(x, y) + rim(x, y))).findings
    assert crater.kind == "crater"
    assert crater.rim_m == pytest.approx(6e-5, abs=2.5e-5)
    assert abs(crater.depth_m + 2e-4) < crater.uncertainty.depth_m
    assert crater.length_m == pytest.approx(3.7e-3, abs=5e-4)
    assert crater.volume_m3 == pytest.approx(-np.pi / 3 * 1.3e-3**2 * 2e-4, rel=0.25)
    # What rises on one side alone is a finding beside a dent.
    kinds = [f.kind for f in inspect(scan(lambda x, y: hollow(x, y) + bump(x, y))).findings]
    assert sorted(kinds) == ["dent", "raised"]


def test_where_little_is_seen_dense_edges_are_a_finding_if_they_lie_off() -> None:
    random = np.random.default_rng(4)

    def keep(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        edge = np.abs(np.hypot(x - 0.016, y) - 6e-4) < 2.5e-4
        return edge | (random.random(x.shape) < 0.003)

    for depth_m, most in ((2e-4, -5e-5), (0.0, None)):
        surface = dent((0.016, 0.0), 1e-3, depth_m)
        found = inspect(scan(surface, length_m=0.032, keep=keep)).findings
        if most is None:  # as what trails behind strong edges does
            assert found == ()
        else:
            (one,) = found
            assert "edges" in one.cues
            assert one.depth_m < most
            np.testing.assert_allclose(one.center_m[:2], [0.016, 0.0], atol=5e-4)
    dense = inspect(scan(dent((0.015, 0.001), 1.5e-3, 2e-4)))
    assert [f.cues for f in dense.findings] == [("height",)]


def test_the_usual_density_is_that_of_the_wide_gaussian_on_all_cells() -> None:
    random = np.random.default_rng(4)
    across = np.linspace(0.2, 3.0, 247)[:, None]  # no multiple of a block
    points = random.poisson(across, (247, 333)).astype(np.float32)
    inside = np.ones(points.shape, bool)
    inside[:, :40] = False
    wide = cv2.GaussianBlur(points, (0, 0), 40.0, borderType=cv2.BORDER_CONSTANT) / 1e-8
    usual = float(np.median(wide[inside]))
    np.testing.assert_allclose(usual_density(points, inside, 1e-4), usual, rtol=0.01)


def test_what_is_smoothed_much_is_the_same_on_a_coarser_grid() -> None:
    random = np.random.default_rng(5)
    values = random.normal(0, 1e-5, (150, 203)).astype(np.float32)
    values[60:80, 90:130] += 1e-4
    weight = (random.random(values.shape) < 0.6).astype(np.float32)
    weight[20:50, 20:60] = 0
    values[weight == 0] = np.nan
    plain, share = smoothed(values, weight, 10.0)
    sums = block_means(weighted(values, weight), 4)
    coarse, coarse_share = smoothed_sums(sums, block_means(weight, 4), 10.0 / 4)
    sure = (slice(10, 140), slice(10, 190))
    found = between_blocks(coarse, 4, values.shape)
    np.testing.assert_allclose(found[sure], plain[sure], atol=2e-6)
    np.testing.assert_allclose(
        between_blocks(coarse_share, 4, values.shape)[sure], share[sure], atol=0.02
    )


def test_few_stray_points_do_not_turn_the_map() -> None:
    first, *rest = scan(flat)
    stray = replace(first, **{name: value[:2] for name, value in vars(first).items()})
    stray.points[:] = [(-0.004, 0.012, 0.0), (-0.004, 0.013, 0.0)]
    found = inspect([stray, first, *rest])
    assert found.height_map is not None
    np.testing.assert_array_equal(found.height_map.base_from_map[:3, :3], np.eye(3))


def test_findings_of_a_scan_given_in_pieces_are_those_of_the_whole() -> None:
    surface = dent((0.048, 0.0), 1.5e-3, 2e-4)
    patches = scan(surface, length_m=0.112, width_m=0.006)
    whole = inspect(patches)
    pieces: list[Piece] = []
    inspector = SurfaceInspector(
        InspectionSettings.create({"height_map.max_cells": 40_000}),
        NominalReference("plane"),
        on_piece=pieces.append,
    )
    for patch in patches:
        inspector.add(patch)
    found = inspector.finish()
    assert len(pieces) > 1
    assert found.height_map is not None
    assert found.height_map.step_m > 1.5e-4
    assert found.height_map.height_m.size <= 40_000
    (one,), (other,) = ([f for f in each.findings if f.depth_m < -1e-4] for each in (whole, found))
    np.testing.assert_allclose(one.center_m, other.center_m, atol=1e-4)
    assert one.depth_m == pytest.approx(other.depth_m, abs=1e-5)


def test_a_pass_beside_one_that_is_given_up_takes_nothing_of_it() -> None:
    bump, hole = dent((0.008, 0.0), 1.5e-3, -2e-4), dent((0.02, 0.008), 1.5e-3, 2e-4)

    def part(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return bump(x, y) + hole(x, y)

    there = scan(part, length_m=0.1, width_m=0.008)
    beside = scan(part, length_m=0.1, width_m=0.008, start=(0.0, 0.008), seed=1)
    found = inspect([*there, *beside], height_map={"max_cells": 40_000})
    assert sorted(round(f.depth_m * 1e4) for f in found.findings) == [-2, 2]
    assert found.height_map is not None
    for side in (found.height_map.y_m < 3.5e-3, found.height_map.y_m > 4.5e-3):
        inner = side & (np.abs(found.height_map.y_m - 0.004) < 7e-3)
        assert found.height_map.known[inner].mean() > 0.9


@pytest.mark.parametrize("away_m", [0.0, 3.0])
def test_what_is_searched_at_once_never_spans_the_scan(
    away_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A dent that the scan begins on stays open; or it goes on metres away."""
    searched, search = [], surface_inspector.search

    def watched(height_map: HeightMap, *given: Any) -> Any:
        searched.append(height_map.height_m.size)
        return search(height_map, *given)

    monkeypatch.setattr(surface_inspector, "search", watched)
    part = dent((0.0, 0.0), 2e-3, -3e-4)
    patches = scan(part, length_m=0.2, width_m=0.008)
    patches += scan(flat, length_m=0.05, width_m=0.008, start=(0.2 + away_m, 0.0))
    found = inspect(patches, height_map={"max_cells": 40_000})
    (one,) = (f for f in found.findings if abs(f.depth_m) > 1e-4)
    assert one.center_m[0] < 2e-3
    assert max(searched) < 120_000


def test_parts_with_a_gap_between_are_compared_as_one() -> None:
    """A step over a gap of 50 mm shows, as long as the whole fits into memory."""
    patches = scan(flat, length_m=0.06, width_m=0.008)
    patches += scan(lambda x, y: flat(x, y) + 4e-4, length_m=0.03, width_m=0.008, start=(0.11, 0.0))
    found = inspect(patches)
    assert found.deviation_m is not None
    x = np.broadcast_to(found.height_map.x_m, found.deviation_m.shape)
    far = found.deviation_m[(x > 0.115) & np.isfinite(found.deviation_m)]
    assert np.abs(found.deviation_m[(x < 0.055) & np.isfinite(found.deviation_m)]).mean() < 1e-4
    assert np.abs(far).mean() > 5e-5


def test_a_finding_is_provisional_until_the_scan_has_passed_it_and_keeps_its_number() -> None:
    patches = scan(dent((0.0235, 0.0), 1.5e-3, 3e-4), length_m=0.09)
    inspector = SurfaceInspector(InspectionSettings.create({}), NominalReference("plane"))
    seen = []
    for patch in patches:
        inspector.add(patch)
        seen.append([(f.id, f.final) for f in inspector.findings])
    assert [(1, False)] in seen
    assert seen[-1] == [(1, True)]
    assert [f.id for f in inspector.finish().findings] == [1]


def test_what_is_far_from_points_is_not_measured(tmp_path: Path) -> None:
    hole = (0.014, 0.016)
    found = inspect(scan(flat, keep=lambda x, y: (x < hole[0]) | (x > hole[1])))
    height_map = found.height_map
    assert height_map is not None
    inside = (height_map.x_m > hole[0] + 4e-4) & (height_map.x_m < hole[1] - 4e-4)
    middle = np.abs(height_map.y_m) < 4e-3
    assert (height_map.state[np.ix_(middle, inside)] < CONTINUED).all()
    assert (height_map.state == MEASURED).mean() > 0.5
    height_map.save(tmp_path / "height_map.npz")
    again = HeightMap.load(tmp_path / "height_map.npz")
    np.testing.assert_array_equal(again.height_m, height_map.height_m)
    np.testing.assert_array_equal(again.state, height_map.state)
    (tmp_path / "other.npz").write_bytes(b"PK")
    with pytest.raises(HeightMapError, match="no height map"):
        HeightMap.load(tmp_path / "other.npz")


def test_what_was_not_compared_is_not_compared_on_a_coarser_map_either() -> None:
    axis, nothing = centres(0, 4, 1e-4), np.zeros((4, 4), np.float32)
    state = np.full((4, 4), MEASURED, np.uint8)
    fine = HeightMap(axis, axis, nothing, nothing, state, state.astype(np.uint16), np.eye(4))
    deviation = np.array([[np.nan, np.nan, np.nan, 2e-4]] * 4, np.float32)
    coarse, found = coarser(fine, deviation, 2)
    assert (coarse.state == MEASURED).all()
    np.testing.assert_allclose(found, [[np.nan, 2e-4]] * 2)


def test_without_points_nothing_is_found() -> None:
    found = inspect([])
    assert found.height_map is None
    assert found.coverage.measured == 0.0


def test_ends_that_came_into_view_too_late_are_outside_but_gaps_are_unmeasured() -> None:
    random = np.random.default_rng(9)

    def keep(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        full = (x > 0.006) & (x < 0.03) & ((x < 0.02) | (x > 0.024))
        return full | (random.random(x.shape) < 0.01)

    bump = dent((0.004, 0.0), 1e-3, -3e-4)
    found = inspect(scan(bump, length_m=0.036, keep=keep))
    assert found.height_map is not None
    assert found.findings == ()
    x = found.height_map.x_m
    state = found.height_map.state
    assert (state[:, (x < 0.005) | (x > 0.031)] == OUTSIDE).all()
    gap = state[:, (x > 0.021) & (x < 0.023)]
    assert (gap == OUTSIDE).mean() < 0.1
    # Lone points, and the gap's borders, are continued by 0.3 mm.
    assert found.coverage.unmeasured == pytest.approx(0.75 * 3.4 / 24, abs=0.03)
