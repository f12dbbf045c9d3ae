"""Cells that hang together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy import ndimage

from roller_inspect.height_map.height_map import F32, Bools

from .cues import Cues

#: Strong places of one finding are two if both rise so many times above what is strong.
_STANDS_OUT = 3.0


@dataclass(frozen=True)
class Component:
    """Cells of one sign that hang together."""

    #: Window around them.
    rows: slice
    columns: slice
    #: Of the window.
    mask: Bools
    #: +1 extra, −1 missing.
    sign: int

    def holds(self, row: int, column: int) -> bool:
        """Whether a cell of the map is one of them."""
        i, j = row - self.rows.start, column - self.columns.start
        inside = 0 <= i < self.mask.shape[0] and 0 <= j < self.mask.shape[1]
        return inside and bool(self.mask[i, j])

    def share_in(self, other: Component) -> float:
        """Share of its cells that are another's too."""
        return self.shared(other) / int(self.mask.sum())

    def shared(self, other: Component) -> int:
        """How many of its cells are another's too."""
        top = max(self.rows.start, other.rows.start)
        left = max(self.columns.start, other.columns.start)
        own, its = (
            c.mask[max(top - c.rows.start, 0) :, max(left - c.columns.start, 0) :]
            for c in (self, other)
        )
        height, width = (min(a, b) for a, b in zip(own.shape, its.shape, strict=True))
        return int((own[:height, :width] & its[:height, :width]).sum())

    def placed(self, top: int, left: int, shape: tuple[int, ...]) -> Bools:
        """Its cells in a window that holds them all and begins at a row and a column."""
        out = np.zeros(shape, bool)
        row, column = self.rows.start - top, self.columns.start - left
        height, width = self.mask.shape
        out[row : row + height, column : column + width] = self.mask
        return out

    def grown(self, reach: int) -> Component:
        """The same and all cells within so many rows and columns of it."""
        around = np.pad(self.mask, reach).astype(np.uint8)
        mask = cv2.dilate(around, np.ones((2 * reach + 1,) * 2, np.uint8)) > 0
        rows, columns = (slice(w.start - reach, w.stop + reach) for w in (self.rows, self.columns))
        return replace(self, rows=rows, columns=columns, mask=mask)


def components(cues: Cues) -> list[Component]:
    """Weak cells that hang together with a strong one, by sign; what only touches is parted."""
    found = []
    for sign in (1, -1):
        weak = cues.weak & (np.sign(cues.z) == sign)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(weak.astype(np.uint8))
        for number in np.unique(labels[cues.strong & weak]):
            x, y, width, height, _ = stats[number]
            box = slice(y, y + height), slice(x, x + width)
            mask = labels[box] == number
            found += [
                Component(*box, part, sign)
                for part in _parted(mask, np.abs(cues.z[box]), cues.strong[box])
            ]
    return sorted(found, key=lambda c: (c.columns.start, c.rows.start, c.sign))


def _parted(mask: Bools, size: F32, strong: Bools) -> list[Bools]:
    """Cells by the nearest of several strong places that stand far above what joins them."""
    sure_cells = mask & strong
    count, labels = cv2.connectedComponents(sure_cells.astype(np.uint8))
    peaks = np.zeros(count)
    np.maximum.at(peaks, labels[sure_cells], size[sure_cells])
    sure = np.flatnonzero(peaks > _STANDS_OUT * size[sure_cells].min())
    if len(sure) < 2:
        return [mask]
    places = np.where(np.isin(labels, sure), labels, 0)
    nearest = ndimage.distance_transform_edt(
        places == 0, return_distances=False, return_indices=True
    )
    return [mask & (places[tuple(nearest)] == number) for number in sure]
