"""Medians by block over cells that are known."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from .height_map import F32, Bools

F64 = npt.NDArray[np.float64]
_Float = TypeVar("_Float", np.float32, np.float64)


def median_known(values: npt.NDArray[np.floating]) -> F64:
    """Median along the last axis of what isn't NaN; NaN where nothing is."""
    ordered = np.sort(values, axis=-1)
    count = np.isfinite(ordered).sum(axis=-1)
    middle = np.stack([np.maximum(count - 1, 0) // 2, count // 2], axis=-1)
    return np.asarray(np.take_along_axis(ordered, middle, axis=-1).mean(axis=-1), np.float64)


def block_medians(values: F32, used: Bools, k: int, least: float) -> F64:
    """Median by block; NaN where too few cells are used.

    Parameters
    ----------
    values : ndarray of float32, shape (ny, nx)
        Blocks at the far ends may be cut.
    used : ndarray of bool, shape (ny, nx)
        Cells that count.
    k : int
        Edge of a block, cells.
    least : float
        Used cells that a block needs.

    Returns
    -------
    ndarray of float64, shape (ceil(ny / k), ceil(nx / k))
        Medians.
    """
    ny, nx = (-(-n // k) for n in values.shape)
    kept = np.full((ny * k, nx * k), np.nan, np.float32)
    kept[: values.shape[0], : values.shape[1]] = np.where(used, values, np.nan)
    blocks = kept.reshape(ny, k, nx, k).swapaxes(1, 2).reshape(ny, nx, -1)
    enough = np.isfinite(blocks).sum(axis=-1) >= least
    return np.where(enough, median_known(blocks), np.nan)


def median_around(blocks: F64, least: int) -> F64:
    """Median of three by three blocks around each; NaN where fewer than so many are known."""
    ny, nx = blocks.shape
    padded = np.pad(blocks, 1, constant_values=np.nan)
    around = np.stack([padded[j : j + ny, i : i + nx] for j in range(3) for i in range(3)], axis=-1)
    return np.where(np.isfinite(around).sum(axis=-1) >= least, median_known(around), np.nan)


def spread_blocks(
    blocks: npt.NDArray[_Float], k: int, shape: tuple[int, ...]
) -> npt.NDArray[_Float]:
    """Values of blocks in each of their cells, shape as given."""
    return np.repeat(np.repeat(blocks, k, axis=0), k, axis=1)[: shape[0], : shape[1]]
