"""How far poses err along the motion, as the events of a texture tell.

Depth is travel over parallax: where poses drift by 2 µm while a row is in view, over 26 mm of
travel, it seems 3 µm too high or too low, and so does all that is seen with it. Under a texture
thousands of lines are in view at once. Where the poses err, all of them have their events beside
them by the same. What grows evenly while a line is in view, the line takes for depth; but lines
ahead and behind see the same places of the camera in other parts of their way, so that how the
error bends is known from all of them. What grows evenly over all of a scan nothing tells.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core import numba_start  # noqa: F401 (before a kernel runs)
from roller_core.transforms import F64
from roller_emvs.evidence.field import ground
from roller_emvs.rays import F32

from .fit import I64, INDEPENDENT, TEXTURE_ROW_STEP
from .near_lines import near_lines

#: Distance of an event from a line from which on it counts for nothing, and pixels to either side
#: of a line that are its own, px.
_TUKEY_PX, _BESIDE = 1.5, 2
#: Parts of the aperture between places of the camera whose errors are found, with straight lines
#: between them; parts that the lines' events are told apart by; rows of lines by such a place.
_KNOTS, _PARTS, _ROWS = 8, 40, 2
#: Errors of poses, and of what hangs on the place in the image alone, before anything is seen, m;
#: the latter in the outermost parts too (so many at either end), where the skin may lie off the
#: surface.
_POSE_M, _PLACE_M, _END_M, _END = 5e-6, 2e-6, 2e-5, 1
#: Events of a row and part from which on it counts, and the share of parts that a row must have.
_ENOUGH, _SEEN = 20, 0.25
#: Least share of the events that tells where lines are: of evenly strewn ones none does.
_LEAST_SHARE = 0.03


class PathError:
    """Finds what poses lack along the motion during one pass.

    Parameters
    ----------
    slopes : tuple of float
        Least and most slope dx/dz of the camera's rays.
    middle_m : float
        Distance of the camera from the plane that places on the strip are of, m.
    """

    def __init__(self, slopes: tuple[float, float], middle_m: float) -> None:
        self._least, most = slopes
        self._width = max(most - self._least, 1e-6) / _PARTS
        self._slopes = self._least + (np.arange(_PARTS) + 0.5) * self._width
        self._middle_m = middle_m
        self._knot_m = _PARTS * self._width * middle_m / _KNOTS
        self._row_m = self._knot_m / _ROWS
        # Normal equations of the parts' own errors and those of knots from the first one on.
        self._first = 0
        place_m = np.full(_PARTS, _PLACE_M)
        place_m[:_END] = place_m[-_END:] = _END_M
        self._matrix: F64 = np.diag(1 / place_m**2)
        self._right: F64 = np.zeros(_PARTS)
        self._errors: F64 = np.zeros(0)
        self.begin(0.0, 0.0)

    def begin(self, start_m: float, end_m: float) -> None:
        """Events that follow are of lines between two places along the strip; none lies before."""
        self._forget_before(start_m)
        self._start_m = start_m
        rows = max(int(np.ceil((end_m - start_m) / self._row_m)), 0)
        self._counts, self._apart = np.zeros((rows, _PARTS)), np.zeros((rows, _PARTS))
        self._totals = np.zeros(2)

    def look(
        self,
        rays: F32,
        slope_scale: float,
        surface: F32,
        lines: tuple[I64, F64, F64],
        columns_m: tuple[float, float],
    ) -> None:
        """Take events and lines of one polarity; `learn` then says what they tell.

        Parameters
        ----------
        rays : ndarray of float32, shape (n, 4)
            Events; see `RaySource`.
        slope_scale : float
            From their slopes to dx/dz.
        surface : ndarray of float32, shape (height, width)
            Offset by pixel, NaN where it is unknown.
        lines : tuple of ndarray, shape (lines,)
            Rows, columns and offsets of the lines through them.
        columns_m : tuple of float
            Where the first column lies along the strip, and how far apart they are, m.
        """
        row, column, offset = lines
        if not len(row):
            return
        pixel, _ = ground(rays, surface)
        left_m, pixel_m = columns_m
        near = near_lines(row, column, surface.shape, _BESIDE, TEXTURE_ROW_STEP)
        _add_apart(
            rays, pixel, near, column, offset, _TUKEY_PX,
            ((left_m - self._start_m) / self._row_m, pixel_m / self._row_m),
            (-self._least / self._width, slope_scale / self._width), pixel_m, self._counts,
            self._apart, self._totals,
        )  # fmt: skip

    def learn(self) -> None:
        """Take what the events since `begin` tell."""
        count = self._counts.sum()
        share, square = self._totals / max(count, 1.0)
        if share >= _LEAST_SHARE:
            # A step of an M-estimate, by Huber: what events are apart, weighted, by how fast that
            # changes with the place of the line.
            weight = INDEPENDENT * share**2 / square
            for row in range(len(self._counts)):
                seen = self._counts[row] >= _ENOUGH
                if seen.mean() >= _SEEN:
                    apart = self._apart[row, seen] / (self._counts[row, seen] * share)
                    root = np.sqrt(self._counts[row, seen] * weight)
                    self._take(self._start_m + (row + 0.5) * self._row_m, seen, apart, root)
        self._errors = np.asarray(np.linalg.solve(self._matrix, self._right)[_PARTS:], np.float64)

    def lacks_m(self, x_m: F64) -> F64:
        """What depths lack at places along the strip, between those of `begin`, by `learn`, m."""
        weight = self._counts.sum(axis=0)
        if not len(self._errors) or np.count_nonzero(weight) < 2:
            return np.zeros_like(x_m)
        rows = self._start_m + (np.arange(len(self._counts)) + 0.5) * self._row_m
        knots = (self._first + np.arange(len(self._errors))) * self._knot_m
        errors = np.interp(rows[:, None] - self._slopes * self._middle_m, knots, self._errors)
        slopes = self._slopes - np.average(self._slopes, weights=weight)
        tilt = errors @ (weight * slopes) / (weight @ slopes**2)
        return np.asarray(np.interp(x_m, rows, tilt))

    def _take(self, x_m: float, seen: np.ndarray, apart: F64, root: F64) -> None:
        """Add what a row of lines saw in some parts to the equations, but for places and depths."""
        slopes = self._slopes[seen]
        at = (x_m - slopes * self._middle_m) / self._knot_m
        knot = np.floor(at).astype(np.int64)
        self._reach(int(knot.min()), int(knot.max()) + 1)
        each = np.arange(len(at))
        rates = np.zeros((len(at), len(self._right)))
        rates[each, np.flatnonzero(seen)] = 1.0
        rates[each, _PARTS + knot - self._first] = 1.0 - (at - knot)
        rates[each, _PARTS + knot - self._first + 1] = at - knot
        free, _ = np.linalg.qr(np.stack([root, root * slopes], axis=1))
        rates, apart = rates * root[:, None], apart * root
        rates -= free @ (free.T @ rates)
        apart -= free @ (free.T @ apart)
        self._matrix += rates.T @ rates
        self._right += rates.T @ apart

    def _forget_before(self, x_m: float) -> None:
        """Leave out places of the camera that rows from a place along the strip on don't see."""
        oldest = int(np.floor((x_m - self._slopes[-1] * self._middle_m) / self._knot_m)) - 1
        drop = min(oldest - self._first, len(self._right) - _PARTS)
        if drop <= 0:
            return
        gone = np.arange(_PARTS, _PARTS + drop)
        kept = np.concatenate([np.arange(_PARTS), np.arange(_PARTS + drop, len(self._right))])
        # What they tell of the others stays (Schur's complement).
        shared = self._matrix[np.ix_(gone, kept)]
        gain = np.linalg.solve(self._matrix[np.ix_(gone, gone)], shared).T
        self._right = self._right[kept] - gain @ self._right[gone]
        self._matrix = self._matrix[np.ix_(kept, kept)] - gain @ shared
        self._errors = self._errors[drop:]
        self._first += drop

    def _reach(self, low: int, high: int) -> None:
        """Make room for knots from one to another."""
        count = len(self._right) - _PARTS
        first = min(self._first, low) if count else low
        last = max(self._first + count, high + 1) if count else high + 1
        before = self._first - first if count else 0
        matrix = np.eye(_PARTS + last - first) / _POSE_M**2
        right = np.zeros(len(matrix))
        old = np.concatenate([np.arange(_PARTS), _PARTS + before + np.arange(count)])
        matrix[np.ix_(old, old)], right[old] = self._matrix, self._right
        self._first, self._matrix, self._right = first, matrix, right


@njit(cache=True, nogil=True)
def _add_apart(  # type: ignore[no-untyped-def]
    rays, pixel, near, column, offset, reach, rows, parts, pixel_m, counts, apart, totals
):
    """Add how far events lie beside the lines they are next to, by row of lines and part.

    `rows` and `parts`: that of the first column and of slope 0, and how many there are to a pixel
    and to a slope. `counts` and `apart`, metres by Tukey's weights, are by row and part; `totals`
    are of how fast the latter change with the place of the lines, and of their squares.
    """
    for i in range(len(rays)):
        k = near[pixel[i]]
        if k < 0:
            continue
        by = rays[i, 0] + rays[i, 2] * offset[k] - column[k]
        v = 1.0 - (by / reach) ** 2
        row = int(np.floor(rows[0] + column[k] * rows[1]))
        part = int(np.floor(parts[0] + rays[i, 2] * parts[1]))
        if v > 0 and 0 <= row < len(counts) and 0 <= part < counts.shape[1]:
            weighted = by * v * v * pixel_m
            counts[row, part] += 1
            apart[row, part] += weighted
            totals[0] += v * (5.0 * v - 4.0)
            totals[1] += weighted * weighted
