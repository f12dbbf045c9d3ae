"""Maps on one grid: joined, and made coarser."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

from .height_map import CONTINUED, F32, MEASURED, OUTSIDE, UNMEASURED, Bools, HeightMap, centres
from .medians import median_known
from .scanned import turn_of

I64 = npt.NDArray[np.int64]
#: Ends are looked at over this length, m, for this share of known cells that are no less certain
#: than so many times the usual, and are no longer than a view, m; in between nearly all cells are
#: known.
_SMOOTH_M, _GOOD_SHARE, _USUAL, _VIEW_M, _DENSE_SHARE = 1e-3, 0.5, 1.25, 0.03, 0.8


def _first_cell(height_map: HeightMap, step_m: float) -> tuple[int, int]:
    """Number of the first column and row on the grid that all maps of a frame share."""
    return (
        round(float(height_map.x_m[0]) / step_m - 0.5),
        round(float(height_map.y_m[0]) / step_m - 0.5),
    )


def join_size(pieces: list[HeightMap]) -> int:
    """Cells that `join` gives."""
    (i0, i1), (j0, j1) = _extent(pieces)
    return (i1 - i0) * (j1 - j0)


def _extent(pieces: list[HeightMap]) -> tuple[tuple[int, int], tuple[int, int]]:
    step = _step(pieces)
    first = [_first_cell(piece, step) for piece in pieces]
    i = [(a, a + len(p.x_m)) for (a, _), p in zip(first, pieces, strict=True)]
    j = [(b, b + len(p.y_m)) for (_, b), p in zip(first, pieces, strict=True)]
    return (min(a for a, _ in i), max(b for _, b in i)), (
        min(a for a, _ in j),
        max(b for _, b in j),
    )


def _step(pieces: list[HeightMap]) -> float:
    return next(piece.step_m for piece in pieces if np.isfinite(piece.step_m))


def join(pieces: list[HeightMap]) -> HeightMap:
    """One map of pieces of one frame and grid; where they overlap what is known best counts."""
    return join_with(pieces, [piece.height_m for piece in pieces])[0]


def join_with(pieces: list[HeightMap], values: list[F32]) -> tuple[HeightMap, F32]:
    """The same, and values that each piece has on its own grid; the last of equally known ones."""
    step = _step(pieces)
    (i0, i1), (j0, j1) = _extent(pieces)
    shape = (j1 - j0, i1 - i0)
    out = HeightMap(
        centres(i0, i1 - i0, step),
        centres(j0, j1 - j0, step),
        np.full(shape, np.nan, np.float32),
        np.full(shape, np.nan, np.float32),
        np.full(shape, OUTSIDE, np.uint8),
        np.zeros(shape, np.uint16),
        pieces[0].base_from_map,
    )
    joined = np.full(shape, np.nan, np.float32)
    for piece, own in zip(pieces, values, strict=True):
        place = window_of(out, piece)
        # A later pass beside an earlier one knows nothing of its cells.
        better = (piece.state >= out.state[place]) & (piece.state != OUTSIDE)
        # Most pieces overlap with none: a copy takes a fifth of one by cell.
        only: Bools | bool = True if better.all() else better
        for grid, new in (
            (out.height_m, piece.height_m), (out.sigma_m, piece.sigma_m), (joined, own),
            (out.points, piece.points), (out.state, piece.state),
        ):  # fmt: skip
            np.copyto(grid[place], new, where=only)
    return out, joined


def window_of(whole: HeightMap, piece: HeightMap) -> tuple[slice, slice]:
    """Rows and columns of a whole that a piece covers."""
    i0, j0 = _first_cell(whole, whole.step_m)
    i, j = _first_cell(piece, whole.step_m)
    return slice(j - j0, j - j0 + piece.shape[0]), slice(i - i0, i - i0 + piece.shape[1])


def without_run_in(height_map: HeightMap) -> HeightMap:
    """A map whose ends are outside where the sensor hadn't come into full view yet.

    At both ends of a scan the roller isn't in contact, or rows are seen over too little travel,
    which makes heights uncertain and bends the surface. On a scan that shows nearly all of the
    surface in between they are no part of it; longer ends than a view, and scans of little
    texture, stay as they are.
    """
    line = _lines_across(height_map)
    share, usual = _by_line(height_map, line)
    k = max(1, round(_SMOOTH_M / height_map.step_m))
    sure = usual <= _USUAL * median_known(usual)
    good = np.nonzero(np.convolve(share * sure, np.ones(k) / k, "same") >= _GOOD_SHARE)[0]
    if not len(good) or np.median(share[good[0] : good[-1] + 1]) < _DENSE_SHARE:
        return height_map
    most = round(_VIEW_M / height_map.step_m)
    ends = np.zeros(len(share), bool)
    if good[0] <= most:
        ends[: good[0]] = True
    if len(share) - 1 - good[-1] <= most:
        ends[good[-1] + 1 :] = True
    ends = ends[line]
    state = np.where(ends, OUTSIDE, height_map.state).astype(np.uint8)
    height = np.where(ends, np.nan, height_map.height_m).astype(np.float32)
    sigma = np.where(ends, np.nan, height_map.sigma_m).astype(np.float32)
    return replace(height_map, state=state, height_m=height, sigma_m=sigma)


def _lines_across(height_map: HeightMap) -> I64:
    """Number of the line across the scan that each cell lies in: its column, or one askew.

    Shape (ny, nx), or (1, nx) where it is the column.
    """
    columns = np.arange(height_map.shape[1])[None, :]
    inside = height_map.state != OUTSIDE
    turn = turn_of(inside, height_map.step_m)
    if not turn:
        return columns
    along = columns * np.cos(turn) + np.arange(height_map.shape[0])[:, None] * np.sin(turn)
    line = np.floor(along).astype(np.int64)
    first, last = line[inside].min(), line[inside].max()
    return np.clip(line, first, last) - first


def _by_line(height_map: HeightMap, line: I64) -> tuple[F64, F64]:
    """Share of known cells by line across the scan, and their median uncertainty."""
    known, inside = height_map.known, height_map.state != OUTSIDE
    if len(line) == 1:
        counts = known.sum(axis=0), inside.sum(axis=0)
        usual = median_known(np.where(known, height_map.sigma_m, np.nan).T)
    else:
        number, sigma = line[known], height_map.sigma_m[known]
        size = int(line.max()) + 1
        counts = np.bincount(number, minlength=size), np.bincount(line[inside], minlength=size)
        sigma = sigma[np.lexsort((sigma, number))].astype(np.float64)
        begin, usual = np.cumsum(counts[0]) - counts[0], np.full(size, np.nan)
        some = counts[0] > 0
        halves = (np.maximum(counts[0] - 1, 0) // 2, counts[0] // 2)
        usual[some] = np.mean([sigma[(begin + half)[some]] for half in halves], axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(counts[0] / counts[1]), usual


def coarser(height_map: HeightMap, deviation_m: F32, factor: int) -> tuple[HeightMap, F32]:
    """A map with cells so many times as long and wide, and the deviation on it.

    A coarse cell is measured, or known, where half of its cells are; its height is their mean, its
    uncertainty theirs, as neighbours share their errors.
    """
    if factor <= 1:
        return height_map, deviation_m
    step = height_map.step_m
    i, j = _first_cell(height_map, step)

    def sums(values: np.ndarray) -> F32:
        return block_means(height_map, values, factor) * factor**2

    def mean(values: F32) -> F32:
        used = height_map.known & np.isfinite(values)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(sums(np.where(used, values, 0)) / sums(used), np.float32)

    half = factor**2 / 2 - 0.25  # counts are whole but for what a float leaves
    inside = sums(height_map.state != OUTSIDE) >= half
    coarse = np.where(inside, UNMEASURED, OUTSIDE)
    coarse[inside & (sums(height_map.known) >= half)] = CONTINUED
    coarse[inside & (sums(height_map.state == MEASURED) >= half)] = MEASURED
    points = np.rint(sums(height_map.points))
    return HeightMap(
        centres(i // factor, points.shape[1], step * factor),
        centres(j // factor, points.shape[0], step * factor),
        mean(height_map.height_m),
        mean(height_map.sigma_m),
        coarse.astype(np.uint8),
        np.minimum(points, 65535).astype(np.uint16),
        height_map.base_from_map,
    ), mean(deviation_m)


def block_means(height_map: HeightMap, values: np.ndarray, factor: int) -> F32:
    """Means of a map's values over cells so many times as long and wide; beyond the map 0."""
    i, j = _first_cell(height_map, height_map.step_m)
    pad = [
        (first % factor, -(first % factor + count) % factor)
        for first, count in zip((j, i), height_map.shape, strict=True)
    ]
    padded = np.pad(values.astype(np.float32), pad)
    size = padded.shape[1] // factor, padded.shape[0] // factor
    return np.asarray(cv2.resize(padded, size, interpolation=cv2.INTER_AREA), np.float32)
