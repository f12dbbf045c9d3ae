"""Smoothed deviations, of cells by weight."""

from __future__ import annotations

import cv2
import numpy as np

from roller_inspect.height_map.height_map import CONTINUED, F32, MEASURED, HeightMap

#: Weight of continued cells, which repeat what measured ones say.
_CONTINUED_WEIGHT = 0.1


def cell_weights(height_map: HeightMap, deviation_m: F32) -> F32:
    """Weights of cells in smoothing: 1 for measured ones, relative to their uncertainty."""
    finite = np.isfinite(deviation_m)
    by_state = np.zeros(256, np.float32)
    by_state[[CONTINUED, MEASURED]] = _CONTINUED_WEIGHT, 1.0
    weight = by_state[height_map.state]
    measured = finite & (height_map.state == MEASURED)
    if measured.any():
        usual = np.median(height_map.sigma_m[measured][::4])
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.square(usual / height_map.sigma_m)
        weight *= np.fmax(np.fmin(ratio, np.float32(2.0)), np.float32(0.1))
    weight[~finite] = 0
    return weight


def smoothed(values: F32, weight: F32, scale_cells: float) -> tuple[F32, F32]:
    """Normalised convolution with a Gaussian: mean, and share of the window with weight."""
    weight = np.asarray(weight, np.float32)
    return smoothed_sums(weighted(values, weight), weight, scale_cells)


def weighted(values: F32, weight: F32) -> F32:
    """Values times their weight; 0 where there is none, whatever the value."""
    return np.asarray(np.where(weight > 0, values, np.float32(0)) * weight, np.float32)


def smoothed_sums(values: F32, weight: F32, scale_cells: float) -> tuple[F32, F32]:
    """`smoothed`, of what is weighted already."""
    size = 2 * int(3.0 * scale_cells + 0.5) + 1
    share, total = (
        np.asarray(
            cv2.GaussianBlur(v, (size, size), scale_cells, borderType=cv2.BORDER_CONSTANT),
            np.float32,
        )
        for v in (weight, values)
    )
    mean = np.full_like(total, np.nan)
    np.divide(total, share, out=mean, where=share > 1e-6)
    return mean, share


def block_means(values: F32, k: int) -> F32:
    """Means of blocks of k by k cells; beyond the last cell is nothing, which counts as 0."""
    if k == 1:
        return values
    whole = np.pad(values, [(0, -n % k) for n in values.shape])
    size = whole.shape[1] // k, whole.shape[0] // k
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32)


def between_blocks(blocks: F32, k: int, shape: tuple[int, ...]) -> F32:
    """Values of cells, linear between the middles of blocks of k by k."""
    if k == 1:
        return blocks
    size = blocks.shape[1] * k, blocks.shape[0] * k
    finer = cv2.resize(blocks, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(finer[: shape[0], : shape[1]], np.float32)
