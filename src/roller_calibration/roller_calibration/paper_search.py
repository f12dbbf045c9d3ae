"""Grid search over the paper's parameters: threshold C, median size G_f, weights of the views.

A window's votes are made once, the threshold's margins once a view. A choice of C is a comparison,
G_f a median over a part of the image, and all weights share the views' warped depths. What comes
out is what `DepthPipeline` would give with those parameters, where the truth is known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.transforms import F64, inverse_pose
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.paper.bma import ViewVotes, usable_planes, view_votes
from roller_emvs.methods.paper.median import masked_median
from roller_emvs.methods.paper.threshold import KERNEL_PX, margins
from roller_emvs.threads import share

from . import _search_kernels as kernels
from .contact import Box, KnownWindow
from .error_table import I64
from .grids import Grid

#: Planes up to which medians come from sums over the image, which take a number a plane.
_MOST_LEVELS = 64


def window_errors(
    window: KnownWindow,
    camera: Camera,
    settings: DepthSettings,
    grid: Grid,
    report: Callable[[float], None] = lambda _share: None,
) -> tuple[F64, I64]:
    """Errors of all choices of the grid over what is known of one window.

    Parameters
    ----------
    window : KnownWindow
        Events, poses and the truth.
    camera : Camera
        Intrinsics.
    settings : DepthSettings
        Method `bma`; everything that the grid doesn't hold.
    grid : Grid
        Choices, of `paper_grid`.
    report : callable
        Gets the share done.

    Returns
    -------
    errors_m : ndarray of float64, shape (grid.size,)
        Sums of absolute errors, metres.
    points : ndarray of int64, shape (grid.size,)
        Measured pixels.
    """
    prepared, s = window.prepared, settings
    thresholds, medians_px, weights = grid.ranges.values()
    voted = view_votes(prepared.packets, camera, prepared.poses, prepared.target, s)
    parts = [
        _ViewPart.cut(voted, k, camera, window, s, max(medians_px) // 2)
        for k in range(len(voted.poses))
    ]
    truth = window.view.depth_m[window.view.mask]
    normalised, counts = _by_pattern(np.asarray(weights))
    errors = np.zeros(grid.shape)
    points = np.zeros(grid.shape, np.int64)
    done: list[int] = []

    def run(c: int) -> None:
        found = [part.depths(thresholds[c], medians_px) for part in parts]
        depth = np.empty((len(parts), len(truth)), np.float32)
        for g in range(len(medians_px)):
            for part, (rows, columns, z), row in zip(parts, found, depth, strict=True):
                part.warp(rows, columns, z[:, g], row)
            kernels._tally(depth, truth, normalised, counts, errors[c, g], points[c, g])
        done.append(c)
        report(len(done) / len(thresholds))

    share(s.threads, len(thresholds), run)
    return errors.reshape(-1), points.reshape(-1)


def _by_pattern(weights: F64) -> tuple[F64, I64]:
    """Weights renormalised over the views that see a pixel, for every set of views.

    Returns
    -------
    normalised : ndarray of float64, shape (2 ** views, views, n)
        0 where the set's weights add up to 0.
    counts : ndarray of int64, shape (2 ** views, n)
        Whether such a pixel is measured.
    """
    views = weights.shape[1]
    sets = (np.arange(2**views)[:, None] >> np.arange(views)) & 1
    kept = sets[:, :, None] * weights.T[None]
    total = kept.sum(axis=1, keepdims=True)
    normalised = np.divide(kept, total, out=np.zeros(kept.shape), where=total > 0)
    return normalised, (total[:, 0] > 0).astype(np.int64)


@dataclass(frozen=True)
class _ViewPart:
    """The part of a reference view's votes that can end up in the contact circle.

    `inner` is where its own depths can; the margin about it only counts for medians. `number` is
    each pixel's place in the list of the circle's pixels, -1 outside; `intrinsics` are fx, fy, cx
    and cy.
    """

    index: npt.NDArray[np.uint16]
    margins: npt.NDArray[np.float32]
    inner: tuple[slice, slice]
    corner: tuple[int, int]
    planes: F64
    bounds_m: tuple[float, float]
    relative: F64
    intrinsics: F64
    box: Box
    number: I64

    @classmethod
    def cut(
        cls,
        voted: ViewVotes,
        k: int,
        camera: Camera,
        window: KnownWindow,
        s: DepthSettings,
        margin_px: int,
    ) -> _ViewPart:
        """Cut a view, with what the largest median reaches."""
        box, target, bounds = (
            window.view.box,
            window.prepared.target,
            (s.depth_min_m, s.depth_max_m),
        )
        seen = inverse_pose(voted.poses[k]) @ target
        u, v = np.meshgrid(
            [box.left - 1.0, box.left + box.width], [box.top - 1.0, box.top + box.height]
        )
        rays = camera.rays(np.stack([u, v], axis=-1).reshape(-1, 2))
        points = np.concatenate([rays * z for z in bounds]) @ seen[:3, :3].T + seen[:3, 3]
        at_u = camera.fx * points[:, 0] / points[:, 2] + camera.cx
        at_v = camera.fy * points[:, 1] / points[:, 2] + camera.cy
        size = (camera.width, camera.height)
        low = np.clip([np.floor(at_u.min()) - 1, np.floor(at_v.min()) - 1], 0, size).astype(int)
        high = np.clip([np.ceil(at_u.max()) + 2, np.ceil(at_v.max()) + 2], low, size).astype(int)
        first = np.maximum(low - margin_px, 0)
        last = np.minimum(high + margin_px, size)
        own = (slice(first[1], last[1]), slice(first[0], last[0]))
        inner = (
            slice(low[1] - first[1], high[1] - first[1]),
            slice(low[0] - first[0], high[0] - first[0]),
        )
        stand_out = margins(voted.votes[k], KERNEL_PX, s.paper.full_scale_votes)
        index = np.ascontiguousarray(voted.index[k][own])
        usable = usable_planes(voted.planes, bounds)
        stand_out = np.where(usable[index], stand_out[own], np.float32(-np.inf))
        number = np.full(window.view.mask.shape, -1, np.int64)
        number[window.view.mask] = np.arange(window.view.pixels)
        same = np.array_equal(voted.poses[k], target)
        return cls(
            index,
            stand_out,
            inner,
            (int(first[0]), int(first[1])),
            voted.planes,
            bounds,
            np.eye(4) if same else inverse_pose(target) @ voted.poses[k],
            np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
            box,
            number,
        )

    def depths(
        self, threshold: float, sizes_px: Sequence[int]
    ) -> tuple[I64, I64, npt.NDArray[np.float32]]:
        """Rows and columns of the pixels that stand out, and their depths for every median."""
        mask = self.margins > threshold
        wanted = np.zeros_like(mask)
        wanted[self.inner] = mask[self.inner]
        rows, columns = np.nonzero(wanted)
        level = medians(self.index, mask, rows, columns, sizes_px, len(self.planes))
        found = np.interp(level, np.arange(len(self.planes)), self.planes)
        inside = (found >= self.bounds_m[0]) & (found <= self.bounds_m[1])
        depth = np.where(inside, found, np.nan).astype(np.float32)
        return rows + self.corner[1], columns + self.corner[0], depth

    def warp(
        self, rows: I64, columns: I64, depth: npt.NDArray[np.float32], out: npt.NDArray[np.float32]
    ) -> None:
        """Put depths where the middle view sees them; out is NaN where it sees none."""
        kernels._warp(
            rows, columns, np.ascontiguousarray(depth), self.relative, self.intrinsics,
            self.box.left, self.box.top, self.number, out,
        )  # fmt: skip


def medians(
    index: npt.NDArray[np.uint16],
    mask: npt.NDArray[np.bool_],
    rows: I64,
    columns: I64,
    sizes_px: Sequence[int],
    levels: int,
) -> npt.NDArray[np.float32]:
    """Masked medians of some pixels over neighbourhoods of several sizes.

    Parameters
    ----------
    index, mask, levels
        As for `masked_median`, whose values these are.
    rows, columns : ndarray of int64, shape (n,)
        Pixels of the mask.
    sizes_px : sequence of int
        Neighbourhoods, odd.

    Returns
    -------
    ndarray of float32, shape (n, sizes)
        Median plane numbers.
    """
    found = np.empty((len(rows), len(sizes_px)), np.float32)
    if levels > _MOST_LEVELS:
        for k, size in enumerate(sizes_px):
            found[:, k] = masked_median(index, mask, size, levels)[rows, columns]
        return found
    sums = np.zeros((index.shape[0] + 1, index.shape[1] + 1, levels), np.int32)
    kernels._sum_levels(index, mask, sums)
    # A row of what `np.nonzero` gives is contiguous or not: two types for the kernel.
    rows, columns = np.ascontiguousarray(rows), np.ascontiguousarray(columns)
    kernels._medians(sums, rows, columns, np.array(sizes_px, np.int64) // 2, found)
    return found
