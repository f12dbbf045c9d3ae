"""Images of aperture parts, against slow forms."""

from dataclasses import replace

import numpy as np
import pytest

from roller_core.events import EventArray
from roller_emvs.evidence import CELL_PX, PartImages, Parts, part_images
from roller_emvs.evidence import _band_kernels as band_kernels
from roller_emvs.evidence import _part_kernels as kernels
from roller_emvs.evidence import _peak_kernels as peaks
from roller_emvs.evidence._band_kernels import BINS
from roller_emvs.evidence._kernels import ROW_PX

SHAPE, MARGIN = (24, 64), 5
SLOPES = np.array([-6.0, -3.7, -1.2, 1.1, 3.4, 5.9])
SPANS = np.array([[0, 40], [0, 52], [3, 64], [8, 74], [17, 74], [26, 74]])
RANGE_M = (0.043, 0.047)


def some_images(rng: np.random.Generator, most: int = 9, share: float = 0.3) -> PartImages:
    """Random counts in the columns that each part saw."""
    images = np.zeros((2, len(SLOPES), SHAPE[0], BINS * (SHAPE[1] + 2 * MARGIN)), np.int64)
    for j, (first, last) in enumerate(SPANS):
        counts = rng.integers(0, most, (2, SHAPE[0], BINS * (last - first)))
        images[:, j, :, BINS * first : BINS * last] = counts * (rng.random(counts.shape) < share)
    return field_of(images)


def field_of(images: np.ndarray) -> PartImages:
    """The events of images, shape (2, parts, rows, bins)."""
    bands = SHAPE[0] // band_kernels.BAND_ROWS
    number = np.argwhere(images).repeat(images[images > 0], axis=0)
    polarity, part, row, at_bin = number[np.random.default_rng(0).permutation(len(number))].T
    band, row = np.divmod(row, band_kernels.BAND_ROWS)
    bucket = polarity * bands + band
    key = (bucket << band_kernels.PART_BITS | part) << band_kernels.ROW_BITS | row
    order = np.argsort(bucket, kind="stable")
    events = (key << band_kernels.BIN_BITS | at_bin)[order].astype(np.uint32)
    starts = np.searchsorted(bucket[order], np.arange(2 * bands + 1))
    by_polarity = np.stack([starts[: bands + 1], starts[bands:]])
    slopes = np.tile([[-8.0], [8.0]], (1, SHAPE[1] // CELL_PX))
    parts = Parts(SLOPES, 2.3, np.arange(len(SLOPES)))
    return PartImages(
        SHAPE, slopes, 0.03, 1.0, 1000.0, 0.0, 1.0, parts, MARGIN, SPANS, events, by_polarity
    )


def images_of(events: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Counts of sorted events by polarity, part, row and bin."""
    images = np.zeros((2, len(SLOPES), SHAPE[0], BINS * (SHAPE[1] + 2 * MARGIN) + 1), np.int64)
    for polarity, band in np.ndindex(starts.shape[0], starts.shape[1] - 1):
        own = events[starts[polarity, band] : starts[polarity, band + 1]].astype(np.int64)
        at_bin, key = own % 2**band_kernels.BIN_BITS, own >> band_kernels.BIN_BITS
        row, part = (
            key % band_kernels.BAND_ROWS,
            (key >> band_kernels.ROW_BITS) % 2**band_kernels.PART_BITS,
        )
        np.add.at(images[polarity], (part, band * band_kernels.BAND_ROWS + row, at_bin), 1)
    return images


def moved(bins: np.ndarray, by: int, edge: int = 0) -> np.ndarray:
    """Rows moved to the right by whole bins, as long as the grid's and an edge."""
    padded = np.pad(bins, ((0, 0), (200, 200)))
    first = 200 + BINS * (MARGIN - edge) - by
    return padded[:, first : first + BINS * (SHAPE[1] + 2 * edge)]


@pytest.mark.parametrize("most", [9, 120])
def test_focus_measure_is_that_of_the_sum_of_shifted_images(most: int) -> None:
    field = some_images(np.random.default_rng(1), most)
    images = images_of(field.events, field.starts)
    at = np.array([-2.2, -0.31, 0.0, 1.7])
    for polarity in (0, 1):
        found = field.focus_measure(at, polarity)
        for k, offset in enumerate(at):
            total = np.zeros((SHAPE[0] // ROW_PX, BINS * (SHAPE[1] + 6)), np.int64)
            for j, slope in enumerate(SLOPES):
                by = int(np.rint(BINS * slope * offset - field.parts.phase[j]))
                rows = images[polarity, j].reshape(len(total), ROW_PX, -1).sum(1)
                # A bin of a pair of rows counts for so much at most.
                total += moved(np.minimum(rows, kernels.MOST_VOTES), by, 3)
            near, beside = total[:, 2::2] + total[:, 3::2], total[:, 1:-3:2] + total[:, 4::2]
            votes = 0.75 * near[:, : SHAPE[1] + 4] + 0.25 * beside
            slopes = 0.4 * (votes[:, 4:] - votes[:, :-4]) + votes[:, 3:-1] - votes[:, 1:-3]
            shape = (SHAPE[0] // CELL_PX, CELL_PX // ROW_PX, SHAPE[1] // CELL_PX, CELL_PX)
            expected = (slopes**2).reshape(shape).sum(axis=(1, 3))
            np.testing.assert_allclose(found[k], expected, rtol=1e-4, atol=1e-2)


def test_tiles_that_hardly_an_event_reaches_are_left_out() -> None:
    field = some_images(np.random.default_rng(1))
    at = np.array([-2.2, 0.0, 1.7])
    whole = field.focus_measure(at, 0)
    tile = kernels.TILE_CELLS * CELL_PX
    # What lies below the tile's row stays; of what comes to it one event.
    images = images_of(field.events, field.starts)[..., :-1]
    images[0, :, : 2 * CELL_PX] = 0
    images[0, 3, 4, BINS * (MARGIN + tile // 2)] = 1
    found = field_of(images).focus_measure(at, 0)
    assert not found[:, :2].any()
    np.testing.assert_array_equal(found[:, 2:], whole[:, 2:])
    images[0, 3, 4, BINS * (MARGIN + tile // 2)] = 40
    assert field_of(images).focus_measure(at, 0)[:, :2, : kernels.TILE_CELLS].any()


def test_statistics_are_those_of_the_bins_at_the_cells_own_shift() -> None:
    rng = np.random.default_rng(2)
    field = some_images(rng)
    offset = rng.uniform(-2, 2, field.cells).astype(np.float32)
    offset[2, 3:6] = np.nan
    found, images = field.slope_sums(offset, 1), images_of(field.events, field.starts)
    expected = np.zeros_like(found)
    for i, c in np.argwhere(np.isfinite(offset)):
        for j, slope in enumerate(SLOPES):
            by = int(np.rint(slope * offset[i, c] - field.parts.phase[j] / BINS))
            bins = moved(images[1, j], BINS * by)
            own = bins[
                i * CELL_PX : (i + 1) * CELL_PX, BINS * CELL_PX * c : BINS * CELL_PX * (c + 1)
            ]
            square = slope**2 + field.parts.width**2 / 12
            expected[i, c] += own.sum() * np.array([1.0, slope, square])
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-3)


def test_support_is_that_of_the_bins_at_the_pixels_own_shift() -> None:
    rng = np.random.default_rng(3)
    field = some_images(rng)
    depth = np.linspace(-2, 2, SHAPE[1])[None, :] + rng.uniform(-0.3, 0.3, (SHAPE[0], 1))
    depth = depth.astype(np.float32)
    depth[4:9, 10:30] = np.nan
    depth[11] = np.nan
    expected, images = np.zeros(SHAPE), images_of(field.events, field.starts)
    for y, x in np.argwhere(np.isfinite(depth)):
        for j, slope in enumerate(SLOPES):
            bins = images[0, j, y]
            where = np.float32(BINS) * (np.float32(x) - np.float32(slope) * depth[y, x])
            first = int(np.floor(where + (field.parts.phase[j] + np.float32(BINS * MARGIN + 0.5))))
            if 0 <= first < BINS * (SHAPE[1] + 2 * MARGIN):
                expected[y, x] += bins[first : first + BINS].sum()
    np.testing.assert_array_equal(field.support(depth, 0), expected)


def test_events_are_counted_where_they_meet_the_middle_plane() -> None:
    rng = np.random.default_rng(4)
    n, packets = 4000, 12
    events = EventArray.from_arrays(
        rng.integers(0, SHAPE[1], n),
        rng.integers(0, SHAPE[0], n),
        np.arange(n),
        rng.random(n) < 0.5,
    )
    table = np.stack(np.meshgrid(np.arange(64.0), np.arange(24.0)), axis=-1).astype(np.float32)
    table += rng.uniform(-0.4, 0.4, table.shape).astype(np.float32)
    table[5, 7] = np.nan
    starts = np.linspace(0, n, packets + 1).astype(np.int64)
    to_middle = np.eye(3) + rng.normal(0, [0.02, 0.02, 1.0], (packets, 3, 3))
    to_middle[:, 2] = [0.0, 1e-4, 1.0]
    parts = Parts(SLOPES, 2.3, rng.integers(0, len(SLOPES), packets))
    of_packets = (events, table, starts, to_middle, parts, SHAPE, MARGIN)
    placed, of_bands, spans = part_images.sort_events(*of_packets)
    found = images_of(placed, of_bands)
    expected = np.zeros_like(found)
    doubtful = 0
    for i in range(n):
        k = int(np.searchsorted(starts, i, side="right")) - 1
        x, y, w = to_middle[k] @ [*table[events.y[i], events.x[i]], 1.0]
        x, y, j = x / w + 0.5 + MARGIN, y / w + 0.5, parts.of_packet[k]
        where = BINS * x + parts.phase[j]
        doubtful += bool(min(abs(v - np.rint(v)) for v in (where, y)) < 1e-3)
        if 0 <= x < SHAPE[1] + 2 * MARGIN and 0 <= y < SHAPE[0]:
            expected[events.p[i], j, int(y), int(where)] += 1
            assert spans[j, 0] <= int(where) // BINS < spans[j, 1]
    assert np.abs(found - expected).sum() <= 2 * doubtful
    assert found.sum() > 0.8 * n
    for threads in (2, 5):
        again = part_images.sort_events(*of_packets, threads)
        np.testing.assert_array_equal(again[1], of_bands)
        np.testing.assert_array_equal(again[0][: of_bands[1, -1]], placed[: of_bands[1, -1]])


@pytest.mark.parametrize("halved", [False, True])
def test_counts_stop_where_they_are_full(halved: bool) -> None:
    rng = np.random.default_rng(7)
    n, bins = 20_000, 90
    key, at_bin = rng.integers(0, 40, n), np.minimum(rng.geometric(0.05, n), bins - 1)
    events = (key << band_kernels.BIN_BITS | at_bin).astype(np.uint32)
    base = bins * np.arange(band_kernels.KEYS)
    found = np.zeros(40 * bins, np.uint8)
    band_kernels._count(events, 100, n - 100, base, halved, np.uint8(20), found)
    counts = np.zeros((40, bins), np.int64)
    np.add.at(counts, (key[100:-100], (at_bin // 2 if halved else at_bin)[100:-100]), 1)
    assert counts.max() > 20
    np.testing.assert_array_equal(found.reshape(counts.shape), np.minimum(counts, 20))


def test_a_plane_lies_where_the_moves_of_its_parts_say() -> None:
    field = some_images(np.random.default_rng(5))
    seen = np.array(field.slopes)
    seen[:, :4] = [[-2.0], [8.0]]
    field = replace(field, slopes=seen)
    at = np.linspace(-2, 2, 7)
    found = field.planes_in_effect(at)
    for k, offset in enumerate(at):
        by = (np.rint(BINS * offset * SLOPES - field.parts.phase) + field.parts.phase) / BINS
        assert found[k, -1] == pytest.approx(np.polyfit(SLOPES, by, 1)[0], abs=1e-6)
        # Columns that a part of the parts saw.
        weight = np.clip((SLOPES + 1.15 + 2.0) / 2.3, 0, 1)
        slant = np.polyfit(SLOPES, by, 1, w=np.sqrt(weight))[0]
        assert found[k, 0] == pytest.approx(slant, abs=1e-6)


def test_top_of_a_parabola_whose_planes_are_uneven() -> None:
    rng = np.random.default_rng(6)
    at = np.cumsum(rng.uniform(0.7, 1.3, (9, 5)), axis=0)
    top = at[4] + rng.uniform(-0.2, 0.2, (3, 5))
    scores = (50 - (at[:, None, :] - top) ** 2).astype(np.float32)
    peak = scores.argmax(axis=0).astype(np.float32)
    peak[1, 2] = np.nan
    # Planes that rounding has put into one place have no parabola.
    k = int(peak[0, 4])
    at[:, 4] = at[k, 4]
    offset = np.full((3, 5), 77, np.float32)
    peaks._top_between(scores, at, peak, offset)
    top[1, 2] = top[:, 4] = 77
    np.testing.assert_allclose(offset, top, atol=1e-3)
