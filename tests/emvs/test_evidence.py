"""What focus and surface share, on fields of rays made for it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from roller_emvs.evidence import CELL_PX, EvidenceSettings, RayField, coarse, find_depths, sweep
from roller_emvs.evidence import _peak_kernels as peaks
from roller_emvs.evidence import _pixel_kernels as pixels
from roller_emvs.evidence import field as evidence_field
from roller_emvs.evidence.field import Box, Mask
from roller_emvs.evidence.focus_measure import all_tiles, plane_offsets
from roller_emvs.evidence.relief import enlarge, measured_pixels
from roller_emvs.lines.edge_drift import SLOPE_BINS, EdgeDriftSettings

SHAPE = (64, 96)
HALF_APERTURE = 10.0
#: Lines uneven enough that no other offset aligns them.
LINES = np.array([11.0, 27.0, 49.0, 78.0])


def field_of(x: np.ndarray, y: np.ndarray, slope: np.ndarray, polarity: np.ndarray) -> RayField:
    """Rays by their place on the plane 0 and slope along x."""
    rays = np.column_stack([x, y, slope, np.zeros_like(slope)]).astype(np.float32)
    on = polarity.astype(bool)
    ordered = np.concatenate([rays[~on], rays[on]])
    bounds = np.array([0, np.count_nonzero(~on), len(on)])
    columns = SHAPE[1] // CELL_PX
    slopes = np.tile([[-HALF_APERTURE], [HALF_APERTURE]], (1, columns))
    # The ray slope grows with the slope and a metre of depth is a unit of offset.
    return RayField(SHAPE, slopes, 0.03, 1.0, 1000.0, 0.0, 1.0, ordered, bounds)


def lines_at(offset: float, rng: np.random.Generator, n: int = 6000) -> tuple[np.ndarray, ...]:
    """Rays of lines that lie at a offset."""
    slope = rng.uniform(-1, 1, n) * HALF_APERTURE
    x = rng.choice(LINES, n) - slope * offset
    y = rng.uniform(0, SHAPE[0], n)
    return x, y, slope, rng.random(n) < 0.5


SETTINGS = EvidenceSettings.create({})


@pytest.mark.parametrize("parts", [1, 4])
@pytest.mark.parametrize("offset", [-0.61, 0.0, 0.37])
def test_lines_are_found_at_their_shift(offset: float, parts: int) -> None:
    field = field_of(*lines_at(offset, np.random.default_rng(1)))
    for found in find_depths(field, -1.0, 1.0, SETTINGS, parts):
        known = np.isfinite(found.offset)
        # Noise of a few tens of votes a cell; a pixel of parallax is 1/20.
        assert known.sum() > 60
        assert abs(np.median(found.offset[known]) - offset) < 0.02
        assert np.mean(np.abs(found.offset[known] - offset) < 0.05) > 0.85


def test_threads_change_nothing() -> None:
    field = field_of(*lines_at(0.2, np.random.default_rng(2)))
    plain = find_depths(field, -1.0, 1.0, SETTINGS)
    for threads in (2, 5):
        for a, b in zip(plain, find_depths(field, -1.0, 1.0, SETTINGS, 1, threads), strict=True):
            np.testing.assert_array_equal(a.offset, b.offset)


def test_polarities_have_depths_of_their_own() -> None:
    rng = np.random.default_rng(3)
    parts = [lines_at(offset, rng) for offset in (-0.4, 0.4)]
    x, y, slope = (np.concatenate([p[k] for p in parts]) for k in range(3))
    polarity = np.repeat([0, 1], [len(p[0]) for p in parts])
    off, on = find_depths(field_of(x, y, slope, polarity), -1.0, 1.0, SETTINGS)
    assert np.nanmedian(off.offset) == pytest.approx(-0.4, abs=0.01)
    assert np.nanmedian(on.offset) == pytest.approx(0.4, abs=0.01)


def test_events_from_one_direction_have_no_depth() -> None:
    """A hot pixel's: a trail over the surface, all of one slope."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, SHAPE[1], 4000), np.full(4000, 30.0)
    field = field_of(x, y, np.full(4000, 3.0), rng.random(4000) < 0.5)
    for found in find_depths(field, -1.0, 1.0, SETTINGS):
        assert not np.isfinite(found.offset).any()


def test_a_column_seen_from_one_side_has_its_edges_depth() -> None:
    """As at the image's border: edges move from plane to plane, and are followed."""
    rng = np.random.default_rng(5)
    x, y, slope, polarity = lines_at(0.3, rng, 12000)
    near = slope > 0
    field = field_of(x[near], y[near], slope[near], polarity[near])
    one_sided = np.array([np.zeros(24), np.full(24, HALF_APERTURE)])
    field = replace(field, slopes=one_sided)
    for found in find_depths(field, -1.0, 1.0, SETTINGS):
        known = np.isfinite(found.offset)
        assert abs(np.median(found.offset[known]) - 0.3) < 0.02
        # Evidence lies on the lines.
        distance = np.abs(found.x[known][:, None] * 4 + 1.5 - LINES).min(axis=1)
        assert np.median(distance) < 2.5


def test_shear_moves_columns_between_cells() -> None:
    rng = np.random.default_rng(8)
    measure = rng.random((3, 5, 12)).astype(np.float32)
    measure[1, 2] = 0
    moved = rng.uniform(-3, 3, (3, 12))
    moved[2, 5:7] = -20, 20
    out = measure.copy()
    most = np.zeros(measure.shape[1:], np.float32)
    peaks._shear(out, moved, most)
    np.testing.assert_array_equal(most, out.max(axis=0))
    for k in range(3):
        for i in range(5):
            padded = np.concatenate([[0, 0, 0, 0], measure[k, i], [0, 0, 0, 0, 0]])
            expected = np.interp(np.arange(12) + moved[k] + 4, np.arange(21), padded)
            np.testing.assert_allclose(out[k, i], expected, atol=1e-6)


def test_pixels_that_gather_more_than_around_are_taken_once() -> None:
    rng = np.random.default_rng(9)
    one, two = rng.random((2, 20, 32)).astype(np.float32)
    one_around, two_around = rng.random((2, 5, 8)).astype(np.float32)
    two[:, :10] = 0
    spans = np.array([[0, 8], [2, 7], [8, 0], [1, 8], [0, 3]])
    which = np.empty((20, 32), np.uint8)
    lines = tuple(np.empty((4, 32), np.float32))
    count = pixels._choose(one, one_around, two, two_around, np.float32(0.3), spans, lines, which)
    off = (one >= np.float32(0.3)) & (one > enlarge(one_around))
    on = (two >= np.float32(0.3)) & (two > enlarge(two_around)) & (two > np.where(off, one, 0))
    inside = in_spans(spans, which.shape)
    off, on = off & inside, on & inside
    np.testing.assert_array_equal(which, np.where(on, 2, np.where(off, 1, 0)))
    assert count == np.count_nonzero(off | on)
    assert {0, 1, 2} == set(which.ravel().tolist())


def in_spans(spans: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    row, column = np.indices(shape) // CELL_PX
    return np.asarray((column >= spans[row, 0]) & (column < spans[row, 1]))


def test_spans_hold_every_cell_of_either_surface() -> None:
    surfaces = np.full((2, 4, 6), np.nan, np.float32)
    surfaces[0, 1, 2], surfaces[1, 1, 4], surfaces[1, 3, :] = 0.0, 1.0, 2.0
    spans = np.empty((4, 2), np.int64)
    pixels._spans(*surfaces, spans)
    assert spans.tolist() == [[0, 0], [2, 5], [0, 0], [0, 6]]


def test_means_of_cells_are_those_of_their_pixels() -> None:
    values = np.random.default_rng(3).integers(0, 9, (12, 16)).astype(np.float32)
    spans, means = np.array([[0, 4], [1, 3], [0, 0]]), np.empty((3, 4), np.float32)
    pixels._cell_means(values, spans, means)
    expected = values.reshape(3, CELL_PX, 4, CELL_PX).mean(axis=(1, 3))
    np.testing.assert_array_equal(means[0], expected[0])
    np.testing.assert_array_equal(means[1], [0, *expected[1, 1:3], 0])
    np.testing.assert_array_equal(means[2], 0)


@pytest.mark.parametrize("shape", [(20, 32), (4, 8)])
def test_the_fringe_of_an_edge_is_dropped(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(4)
    images = (rng.random((2, *shape)) ** 8 * 40).astype(np.float32)
    images[:, :, shape[1] // 2 :] *= 0.1
    which = rng.integers(0, 3, shape).astype(np.uint8)
    spans = np.tile([0, shape[1] // CELL_PX], (shape[0] // CELL_PX, 1))
    spans[-1] = 1, 2
    most = cv2.blur(images.max(axis=0), (3, 5))
    around = cv2.dilate(most, np.ones((1, 2 * pixels.NEAR_PX + 1), np.uint8))
    fringe = (most < np.float32(0.4) * around) & in_spans(spans, shape)
    expected = np.where(fringe, 0, which)
    lines = tuple(np.empty((2, shape[1] + 2 * pixels.NEAR_PX), np.float32))
    pixels._drop_fringe(*images, 0.4, spans, lines, which)
    np.testing.assert_array_equal(which, expected)


def test_what_is_taken_lies_between_cells() -> None:
    rng = np.random.default_rng(10)
    which = rng.integers(0, 3, (24, 32)).astype(np.uint8)
    surfaces = tuple(rng.random((2, 24, 32)).astype(np.float32))
    cells = rng.random((3, 6, 8)).astype(np.float32)
    cells[2, 2, 3] = np.nan
    count = np.count_nonzero(which)
    row, column = (np.empty(count, np.int64) for _ in range(2))
    offset, sure, spread = (np.empty(count, np.float32) for _ in range(3))
    images, spans = tuple(cells[:2]), np.tile([0, 8], (6, 1))
    out = (row, column, offset, sure, spread)
    taken = pixels._take(which, spans, surfaces, images, cells[2], (9.0, 99.0, 0.0), *out)
    assert taken == count
    np.testing.assert_array_equal((row, column), np.nonzero(which))
    second = which[row, column] == 2
    wide = enlarge(cells[2])[row, column]
    assert np.isnan(wide).any()
    wide = np.where(np.isnan(wide), 9.0, wide)
    np.testing.assert_allclose(spread, wide, atol=1e-6)
    sure *= 1 + wide**2
    for found, images in ((offset, surfaces), (sure, [enlarge(c) for c in cells[:2]])):
        expected = np.where(second, images[1][row, column], images[0][row, column])
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)


def test_planes_are_as_many_as_parallax_and_reach_beyond_the_ends() -> None:
    at = plane_offsets(-1.0, 1.0, 20.0, 0.5)
    assert len(at) == 13
    assert (at[1], at[-2]) == pytest.approx((-1.0, 1.0))
    assert len(plane_offsets(-1.0, 1.0, 0.5, 0.5)) == 7
    assert len(plane_offsets(-1.0, 1.0, 1e6, 0.5)) == 502


def test_edges_seen_from_both_sides_alone_have_no_depth() -> None:
    """Two edges that come to lie on each other from the ends of the aperture pass for one."""
    rng = np.random.default_rng(7)
    x, y, slope, polarity = lines_at(0.2, rng)
    # Of one line the middle of the aperture saw nothing.
    two_sided = (np.abs(x + slope * 0.2 - LINES[1]) < 1) & (np.abs(slope) < 0.7 * HALF_APERTURE)
    whole = find_depths(field_of(x, y, slope, polarity), -1.0, 1.0, SETTINGS)
    keep = ~two_sided
    parts = find_depths(
        field_of(x[keep], y[keep], slope[keep], polarity[keep]), -1.0, 1.0, SETTINGS
    )
    cells = slice(int(LINES[1]) // CELL_PX - 1, int(LINES[1]) // CELL_PX + 2)
    for before, after in zip(whole, parts, strict=True):
        assert np.isfinite(before.offset[:, cells]).sum() > 10
        assert not np.isfinite(after.offset[:, cells]).any()
        others = np.isfinite(after.offset)
        assert others.sum() > 40
        assert np.mean(np.abs(after.offset[others] - 0.2) < 0.05) > 0.85


@pytest.mark.parametrize("parts", [1, 4])
def test_tiles_left_out_hold_no_depth(parts: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With all tiles looked at on all planes the depths are the same."""
    field = field_of(*lines_at(0.2, np.random.default_rng(1)))
    found = find_depths(field, -1.0, 1.0, SETTINGS, parts)
    monkeypatch.setattr(sweep, "tiles_searched", lambda f, _a, _b, n: all_tiles(f, n))
    for module in (sweep, coarse):
        monkeypatch.setattr(module, "tiles_reached", lambda _r, f, at: all_tiles(f, len(at)))
    for a, b in zip(found, find_depths(field, -1.0, 1.0, SETTINGS, parts), strict=True):
        np.testing.assert_allclose(a.offset, b.offset, atol=0.02)


def test_cutting_off_what_holds_no_depth_changes_none(monkeypatch: pytest.MonkeyPatch) -> None:
    x, y, slope, polarity = lines_at(0.2, np.random.default_rng(1))
    # A patch of a large grid.
    field = replace(
        field_of(x[x < 60], 90.0 + 0.5 * y[x < 60], slope[x < 60], polarity[x < 60]),
        shape=(280, SHAPE[1]),
    )
    cut, shapes = RayField.cut_around, []

    def watched(whole: RayField, cells: Mask, reach: int) -> tuple[RayField, Box] | None:
        found = cut(whole, cells, reach)
        if found is not None:
            shapes.append(found[0].shape)
        return found

    monkeypatch.setattr(RayField, "cut_around", watched)
    drift, found = EdgeDriftSettings.create({}), []
    for _ in range(2):
        depths = find_depths(field, -1.0, 1.0, SETTINGS)
        found.append((depths, measured_pixels(field, depths, SETTINGS, drift)))
        monkeypatch.setattr(evidence_field, "_MOST_CUT", 0.0)
    assert len(shapes) == 3
    assert all(shape[0] < 150 for shape in shapes)
    for own, whole in zip(found[0][0], found[1][0], strict=True):
        for name in ("offset", "confidence", "focus_measure"):
            np.testing.assert_allclose(getattr(own, name), getattr(whole, name), rtol=1e-5)
    points, expected = found[0][1], found[1][1]
    assert len(points.row) > 80
    np.testing.assert_array_equal(points.row, expected.row)
    np.testing.assert_array_equal(points.column, expected.column)
    np.testing.assert_allclose(points.offset, expected.offset, atol=1e-4)
    np.testing.assert_allclose(points.sigma, expected.sigma, rtol=1e-3)
    for own, whole in zip(points.surfaces, expected.surfaces, strict=True):
        np.testing.assert_allclose(own, whole, atol=1e-4)


@pytest.mark.parametrize("seen", ["both", "off", "on"])
def test_what_one_polarity_shows_is_as_unsure_as_its_drift(seen: str) -> None:
    """Of 0.06 and 0.02 m; where both show it as a mean of these is, and never less."""
    values = [0.06] * 2 * SLOPE_BINS + [0.02] * 2 * SLOPE_BINS
    drift = EdgeDriftSettings.create(
        {"coefficients_m": [0.0] * 4, "residual_m": values, "max_slope": 1.0}
    )
    x, y, slope, polarity = lines_at(0.1, np.random.default_rng(5))
    polarity = {"both": polarity, "off": 0 * polarity, "on": 0 * polarity + 1}[seen]
    field = field_of(x, y, slope, polarity)
    depths = find_depths(field, -1.0, 1.0, SETTINGS)
    plain = measured_pixels(field, depths, SETTINGS, EdgeDriftSettings.create({}))
    found = measured_pixels(field, depths, SETTINGS, drift).whole()
    of_drift = np.sqrt(np.median(found.sigma) ** 2 - np.median(plain.sigma) ** 2)
    expected = 0.06 if seen == "off" else 0.5 * np.hypot(0.06, 0.02)
    assert of_drift == pytest.approx(expected, rel=0.1)


def test_the_fringe_of_an_edge_gives_no_points() -> None:
    """What holds little is measured by itself, but not close beside an edge of ten times more."""
    taken = {}
    for name, beside in (("alone", 88.0), ("beside", 54.0)):
        rng = np.random.default_rng(11)
        n = 12000
        slope = rng.uniform(-1, 1, n) * HALF_APERTURE
        x = np.where(rng.random(n) < 0.09, beside, 49.0)
        field = field_of(x, rng.uniform(0, SHAPE[0], n), slope, rng.random(n) < 0.5)
        depths = find_depths(field, -1.0, 1.0, SETTINGS)
        found = measured_pixels(field, depths, SETTINGS, EdgeDriftSettings.create({}))
        taken[name] = np.count_nonzero(found.column == beside)
        assert np.count_nonzero(found.column == 49.0) > 50
    assert taken["alone"] > 30
    assert taken["beside"] == 0
