"""Points in, strips of the height map out, with memory for what is near."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64, inverse_pose
from roller_emvs.patch import Patch

from .cells import bin_points
from .complete import complete
from .height_map import Bools, HeightMap, centres
from .map_frame import find_frame
from .map_settings import HeightMapSettings
from .part_extent import PartExtent, main_body

#: Length of a strip, and what a strip is completed with on either side, m.
STRIP_M, OVERLAP_M = 8e-3, 2e-3
#: So many neighbours are completed together at most.
_MOST_AT_ONCE = 6
#: The frame is found once the scan has gone so far, m, and has so many points.
_START_M, _START_POINTS = 8e-3, 60
#: Patches with less than this part of the largest one's points don't say where the scan goes.
_LEAST_PATCH = 0.05
#: Rows are allocated so many at once.
_ROWS = 32


@dataclass
class _Strip:
    """Points of a strip: x from its start, y, height, sigma, each (4, n); whether it is mapped."""

    points: list[npt.NDArray[np.float32]]
    done: bool = False


class HeightMapper:
    """Makes the height map strip by strip.

    The map's frame, `base_from_map`, is found from the first points.

    Attributes
    ----------
    left_out : int
        Points that are nowhere, or further from the others than any of a part.
    """

    def __init__(self, settings: HeightMapSettings) -> None:
        self.settings = settings
        self.base_from_map: F64 | None = None
        self.columns = max(1, round(STRIP_M / settings.grid_m))
        self._overlap = max(1, round(OVERLAP_M / settings.grid_m))
        self._waiting: list[Patch] = []
        self._strips: dict[int, _Strip] = {}
        self._extent = PartExtent()
        self.left_out = 0

    @property
    def length_m(self) -> float:
        """Of a strip."""
        return self.columns * self.settings.grid_m

    @property
    def frame(self) -> F64:
        """base_from_map, once there is a strip."""
        assert self.base_from_map is not None
        return self.base_from_map

    def add(self, patch: Patch) -> list[int]:
        """Take points.

        Returns
        -------
        list of int
            Strips that the scan has passed, in order; `strip` gives them.
        """
        good = np.isfinite(patch.points).all(axis=1) & np.isfinite(patch.sigma)
        self.left_out += int((~good).sum())
        # One that is nowhere would take the map's frame with it.
        patch = _chosen(patch, good)
        if not len(patch):
            return []
        if self.base_from_map is None:
            self._waiting.append(patch)
            if not self._find_frame(enough=False):
                return []
            waiting, self._waiting = self._waiting, []
            spans = [span for each in waiting if (span := self._take(each)) is not None]
        else:
            span = self._take(patch)
            spans = [] if span is None else [span]
        if not spans:
            return []
        low, high = spans[-1]
        margin = self._overlap / self.columns
        passed = [
            k
            for k, strip in self._strips.items()
            if not strip.done and (k + 1 + margin < low or k - margin > high)
        ]
        return self._mark(passed)

    def finish(self) -> list[int]:
        """The scan is over: the strips that are left."""
        if self._waiting and self.base_from_map is None:
            self._find_frame(enough=True)
        waiting, self._waiting = self._waiting, []
        for patch in waiting:
            self._take(patch)
        return self._mark([k for k, strip in self._strips.items() if not strip.done])

    @property
    def under_way(self) -> set[int]:
        """Strips that the scan has points of and hasn't passed."""
        return {k for k, strip in self._strips.items() if not strip.done}

    def forget(self, strips: list[int]) -> None:
        """Give up the points of strips; later ones there begin anew."""
        for k in strips:
            self._strips.pop(k, None)

    def strips(self, numbers: list[int]) -> dict[int, HeightMap]:
        """Maps of strips, as the points so far have them; neighbours are completed together."""
        runs: list[list[int]] = []
        for k in numbers:
            if runs and k == runs[-1][-1] + 1 and len(runs[-1]) < _MOST_AT_ONCE:
                runs[-1].append(k)
            else:
                runs.append([k])
        return {k: strip for run in runs for k, strip in self._run(run[0], len(run)).items()}

    def _run(self, first: int, count: int) -> dict[int, HeightMap]:
        """Maps of so many strips one after the other."""
        grid, n, m = self.settings.grid_m, self.columns, self._overlap
        points = self._points(first, count)
        low, high = np.floor(np.array([points[1].min(), points[1].max()]) / grid)
        rows = int(low // _ROWS * _ROWS), int((high // _ROWS + 1) * _ROWS)
        shape = rows[1] - rows[0], count * n + 2 * m
        x, y, heights, sigmas = points
        cells = bin_points(x / grid + m, y / grid - rows[0], heights, sigmas, shape)
        height, sigma, state = complete(cells, self.settings)
        place = centres(first * n - m, shape[1], grid), centres(rows[0], shape[0], grid)
        whole = HeightMap(*place, height, sigma, state, cells.points, self.frame)
        starts = {first + i: m + i * n for i in range(count)}
        return {k: whole.cropped(slice(at, at + n), slice(None)) for k, at in starts.items()}

    def _find_frame(self, enough: bool) -> bool:
        kept = main_body(np.concatenate([patch.points for patch in self._waiting]).T)
        ends = np.cumsum([len(patch) for patch in self._waiting])
        each = zip(self._waiting, np.split(kept, ends[:-1]), strict=True)
        body = [_chosen(patch, which) for patch, which in each if which.any()]
        points = np.concatenate([patch.points for patch in body])
        motion = _motion(body)
        if not enough and (len(points) < _START_POINTS or np.linalg.norm(motion) < _START_M):
            return False
        surface_z_m = float(np.median(body[0].points[:, 2] - body[0].height))
        self.base_from_map = find_frame(points, motion, round(surface_z_m, 9))
        self.left_out += len(kept) - len(points)
        self._waiting = body
        return True

    def _take(self, patch: Patch) -> tuple[int, int] | None:
        """Points to their strips; first and last strip touched, None where none was."""
        map_from_base = inverse_pose(self.frame)
        # By axis: the rows are short, and each would cost a loop of its own.
        local = np.empty((4, len(patch)))
        local[:3] = map_from_base[:3, :3] @ patch.points.T + map_from_base[:3, 3, None]
        local[3] = patch.sigma
        good = np.isfinite(local).all(axis=0)
        if not good.all():
            local = local.compress(good, axis=1)
        if local.size and (near := self._extent.take(local[:3])) is not None:
            local = local.compress(near, axis=1)
        self.left_out += len(patch) - local.shape[1]
        if not local.size:
            return None
        number = np.floor(local[0] / self.length_m).astype(np.int64)
        touched = np.unique(number)
        for k in touched.tolist():
            columns = local.compress(number == k, axis=1)
            columns[0] -= k * self.length_m
            strip = self._strips.setdefault(k, _Strip([]))
            strip.points.append(columns.astype(np.float32))
            strip.done = False
        return int(touched[0]), int(touched[-1])

    def _mark(self, strips: list[int]) -> list[int]:
        for k in strips:
            self._strips[k].done = True
        return sorted(strips)

    def _points(self, first: int, count: int) -> F64:
        """Points of some strips and of those beside: x from the first on, y, height, sigma."""
        parts = []
        for k in range(first - 1, first + count + 1):
            strip = self._strips.get(k)
            if strip is None:
                continue
            if len(strip.points) > 1:
                strip.points = [np.concatenate(strip.points, axis=1)]
            moved = strip.points[0].astype(np.float64)
            moved[0] += (k - first) * self.length_m
            parts.append(moved)
        return np.concatenate(parts, axis=1)


def _motion(patches: list[Patch]) -> F64:
    """How far the points moved from the first patch to the last, by regression."""
    count = np.array([len(patch) for patch in patches])
    number = np.flatnonzero(count >= _LEAST_PATCH * count.max())
    used = [patches[k] for k in number]
    count = count[number]
    centred = number - number @ count / count.sum()
    spread = float(centred**2 @ count)
    if not spread:
        return np.zeros(3)
    totals = np.array([patch.points.sum(axis=0) for patch in used])
    return np.asarray(centred @ totals / spread * (number[-1] - number[0]))


def _chosen(patch: Patch, which: Bools) -> Patch:
    """Some points of a patch; mostly they are all."""
    if which.all():
        return patch
    return Patch(patch.points[which], *(v[which] for v in patch.properties()))
