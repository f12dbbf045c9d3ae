"""Where along the roll the skin lies on the surface: its ends lift off, and move apart from it.

A soft roller touches what it rolls over along a patch. Where the image reaches beyond, the skin is
still bright, and what is printed on it moves otherwise than the surface does. A few columns that
err by half a pixel at either end, where the baseline is longest, put all of a surface too high or
too low. Under a texture they show: their events lie beside the lines that all others agree on.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core import numba_start  # noqa: F401 (before a kernel runs)
from roller_core.transforms import F64
from roller_emvs.evidence.field import ground
from roller_emvs.rays import F32

from .fit import I64, TEXTURE_ROW_STEP
from .near_lines import near_lines

#: Columns of the image that are looked at as one, px.
_COLUMNS_PX = 4.0
#: An event within this of a line is of it, and pixels to either side of one that are its own, px.
_MOST_PX, _BESIDE = 1.5, 1
#: Events from which on columns tell where they lie, and do so surely. An end is known once so many
#: of its outermost columns do: as a pass begins, one of them sees little, and later than what is
#: further in. Where few events come, so that a quarter of the lesser number came with earlier
#: looks, that will do for an end off the surface; where the outermost columns hardly see anything,
#: as of an image that is turned, so many of the end.
_ENOUGH, _SURELY_ENOUGH, _OUTERMOST, _ENOUGH_AT_END = 250, 500, 3, 40_000
#: Part of the aperture that is an end, and the part at most that may be off the surface.
_END, _MOST_OFF = 0.1, 0.2
#: Parts of the aperture that say how events lie where the skin is on the surface: at first, and
#: but for the ends that this told.
_INNER = 0.6, 0.9
#: Columns whose events lie further than this beside the lines are off it, and the outermost ones
#: in the mean further than this if any are, px.
_APART_PX, _SURELY_PX = 0.06, 0.1


class PatchEnds:
    """Finds the ends of the contact patch from events of a texture and the lines through them.

    Parameters
    ----------
    slopes : tuple of float
        Least and most slope dx/dz of the camera's rays.
    focal_px : float
        Focal length, px.
    """

    def __init__(self, slopes: tuple[float, float], focal_px: float) -> None:
        self._low, self._high = slopes
        count = max(round((self._high - self._low) * focal_px / _COLUMNS_PX), 1)
        self._sums, self._counts = np.zeros(count), np.zeros(count, np.int64)
        #: Slopes between which the skin is on the surface, infinite while an end isn't known.
        self.ends = (-np.inf, np.inf)
        self._known = [False, False]
        #: Events that the outermost columns had when the ends were last looked for.
        self._before = [0, 0]

    @property
    def known(self) -> bool:
        """Whether both ends were looked at."""
        return all(self._known)

    def look(
        self, rays: F32, seen_at: F64, surface: F32, row: I64, column: F64, offset: F64
    ) -> None:
        """Take events and lines of one polarity; `find` then says what they tell.

        Parameters
        ----------
        rays : ndarray of float32, shape (n, 4)
            Events; see `RaySource`.
        seen_at : ndarray of float64, shape (n,)
            Slope dx/dz at which the camera saw each, in its own frame.
        surface : ndarray of float32, shape (height, width)
            Offset by pixel, NaN where it is unknown.
        row, column, offset : ndarray, shape (lines,)
            Where the lines through them lie.
        """
        if not len(row):
            return
        pixel, _ = ground(rays, surface)
        near = near_lines(row, column, surface.shape, _BESIDE, TEXTURE_ROW_STEP)
        per_bin = len(self._sums) / (self._high - self._low)
        _add_beside(
            rays, seen_at, pixel, near, column, offset, _MOST_PX, self._low, per_bin, self._sums,
            self._counts,
        )  # fmt: skip

    def find(self) -> bool:
        """Look for the ends; whether they are nearer than they were."""
        ends = self.ends
        self._find()
        self._before = [_least(c) for c in (self._counts, self._counts[::-1])]
        return self.ends != ends

    def _find(self) -> None:
        """The ends, as far as enough events tell."""
        count = len(self._sums)
        enough = self._counts >= _ENOUGH
        apart = self._sums / np.maximum(self._counts, 1)
        middle = 2 * np.abs((np.arange(count) + 0.5) / count - 0.5)
        off = 0, 0
        for inner in _INNER:
            beside = enough & (middle < inner)
            beside[: off[0]] = beside[count - off[1] :] = False
            if beside.sum() < 3:
                return
            # Lines follow the ends a little: what grows evenly along the aperture is a depth.
            rest = apart - _line(apart, beside)
            if np.sqrt(np.mean(rest[beside] ** 2)) > _SURELY_PX:
                return  # what is not even in the middle tells nothing of the ends
            off = _off(rest, enough), _off(rest[::-1], enough[::-1])
        width = (self._high - self._low) / count
        size = max(round(_END * count), 1)
        low, high = self.ends
        if self._settles(0, self._counts[:size], off[0]):
            low = self._low + off[0] * width if off[0] else low
        if self._settles(1, self._counts[::-1][:size], off[1]):
            high = self._high - off[1] * width if off[1] else high
        self.ends = (low, high)

    def _settles(self, end: int, counts: I64, off: int) -> bool:
        """Whether an end gets known; its columns, the outermost first, how many lie off."""
        if self._known[end]:
            return False
        least = _least(counts)
        few = off > 0 and least >= _ENOUGH and self._before[end] >= _ENOUGH // 4
        self._known[end] = few or least >= _SURELY_ENOUGH or bool(counts.sum() >= _ENOUGH_AT_END)
        return self._known[end]


def _least(counts: I64) -> int:
    """Events of that of the outermost columns that has the fewest."""
    return int(counts[:_OUTERMOST].min())


def _line(apart: F64, which: np.ndarray) -> F64:
    """The straight line through some of the values over their numbers."""
    place = np.arange(len(apart), dtype=np.float64)
    return np.asarray(np.polyval(np.polyfit(place[which], apart[which], 1), place))


def _off(apart: F64, enough: np.ndarray) -> int:
    """How many of the first columns lie off the surface; 0 if it is too many to be an end."""
    told = np.flatnonzero(enough)
    away = np.abs(apart[told])
    # Two that lie on it in a row, as one may by chance, and the one before them to be sure.
    on = np.flatnonzero(np.maximum(away[:-1], away[1:]) <= _APART_PX)
    if not len(on) or on[0] == 0 or abs(apart[told[:_OUTERMOST]].mean()) <= _SURELY_PX:
        return 0
    off = int(told[on[0]]) + 1
    return off if off <= _MOST_OFF * len(apart) else 0


@njit(cache=True, nogil=True)
def _add_beside(  # type: ignore[no-untyped-def]
    rays, seen_at, pixel, near, column, offset, most, low, per_bin, sums, counts
):
    """Add how far events lie beside the lines they are next to, by where the camera saw them."""
    for i in range(len(rays)):
        k = near[pixel[i]]
        if k < 0:
            continue
        apart = rays[i, 0] + rays[i, 2] * offset[k] - column[k]
        bin_ = int(np.floor((seen_at[i] - low) * per_bin))
        if abs(apart) <= most and 0 <= bin_ < len(sums):
            sums[bin_] += apart
            counts[bin_] += 1
