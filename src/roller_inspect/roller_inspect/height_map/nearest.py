"""Which known cell is nearest."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from .height_map import Bools


def nearest_known(known: Bools) -> npt.NDArray[np.intp]:
    """Index of the nearest known cell in the flattened grid, for each cell.

    By chamfer distances of 5 by 5 cells (Borgefors, 1986), which take half of the time of exact
    ones: the cell named is at most 4 % further than the nearest one, and within 3 cells it is that.

    Parameters
    ----------
    known : ndarray of bool, shape (ny, nx)
        One at least.
    """
    unknown = (~known).view(np.uint8)
    _, labels = cv2.distanceTransformWithLabels(
        unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    index = np.flatnonzero(known)
    of_label = np.empty(len(index) + 1, np.intp)
    of_label[labels.ravel()[index]] = index
    return np.asarray(of_label[labels])


def distance_to(index: npt.NDArray[np.intp]) -> npt.NDArray[np.float32]:
    """Distance of each cell to the one that `nearest_known` names, in cells."""
    ny, nx = index.shape
    row, column = np.divmod(index.astype(np.int32), np.int32(nx))
    row -= np.arange(ny, dtype=np.int32)[:, None]
    column -= np.arange(nx, dtype=np.int32)
    return np.sqrt((row * row + column * column).astype(np.float32))
