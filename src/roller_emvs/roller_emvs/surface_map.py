"""The whole scan thinned to a bounded size, for whoever joins late."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from pydantic import Field

from roller_core.errors import RollerError, UnwritableOutputError
from roller_core.outputs import SURFACE_MAP, Cloud, Output, Result
from roller_core.settings import Settings
from roller_core.transforms import F64

from .patch import SURFACE_FIELDS, SURFACE_PROPERTIES, Patch
from .ply import PlyWriter
from .voxels import I64, REACH, all_of, cell_key, cells_of_keys

#: Points that wait before they are merged, so that many small patches cost little.
_MOST_WAITING = 250_000
#: Edge of its voxels at first; each keeps the point it is surest of.
_VOXEL_M = 1e-4
#: The map is given at most this often, s of the scan.
PERIOD_S = 1.0


class EmptyMapError(RollerError):
    """There is nothing to save yet."""


class MapSettings(Settings):
    """The thinned map of a scan."""

    max_points: int = Field(
        500_000, ge=100, le=50_000_000, description="Points at most; when full, voxels get larger."
    )
    folder: str = Field("surface_maps", description="Folder that ~/save writes to.")


class SurfaceMap:
    """The point of most confidence of each voxel; the voxels double when they are too many.

    What it holds depends on the points and their order alone, not on when it was looked at.

    Parameters
    ----------
    max_points : int
        Points at most.
    voxel_m : float
        Edge of a voxel at first, metres.

    Attributes
    ----------
    voxel_m : float
        Edge of a voxel now, metres.
    """

    def __init__(self, max_points: int, voxel_m: float) -> None:
        self.voxel_m = voxel_m
        self._max = max_points
        self._origin: F64 | None = None
        self._keys = np.empty(0, np.int64)
        # Columns: x, y, z, height, confidence, sigma, number in the order of arrival.
        self._rows = np.empty((0, 7))
        self._waiting: list[F64] = []
        self._count = self._arrived = 0

    def __len__(self) -> int:
        """Points, without those that wait to be merged."""
        return len(self._keys)

    def add(self, patch: Patch) -> None:
        """Take points; those that are not finite or beyond `REACH` voxels are left out."""
        numbers = np.arange(self._arrived, self._arrived + len(patch))
        rows = np.column_stack([patch.points, *patch.properties(), numbers])
        self._arrived += len(patch)
        finite = np.isfinite(rows)
        self._waiting.append(rows if finite.all() else rows[finite.all(axis=1)])
        self._count += len(patch)
        if self._count > _MOST_WAITING:
            self._merge()

    def patch(self) -> Patch:
        """All points, in the order of their voxels."""
        self._merge()
        rows = self._rows
        return Patch(rows[:, :3].copy(), *rows[:, 3:6].T.astype(np.float32))

    def _merge(self) -> None:
        if not self._count:
            return
        rows = np.concatenate(self._waiting)
        self._waiting, self._count = [], 0
        if not len(rows):
            return
        if self._origin is None:
            self._origin = rows[0, :3].copy()
        cells = np.floor((rows[:, :3] - self._origin) / self.voxel_m)
        near = all_of(np.abs(cells) < REACH)
        keys, rows = _best(cell_key(cells[near].astype(np.int64)), rows[near])
        place = np.searchsorted(self._keys, keys)
        known = place < len(self._keys)
        known[known] = self._keys[place[known]] == keys[known]
        at = place[known]
        surer = rows[known, 4] > self._rows[at, 4]
        self._rows[at[surer]] = rows[known][surer]
        self._keys = np.insert(self._keys, place[~known], keys[~known])
        self._rows = np.insert(self._rows, place[~known], rows[~known], axis=0)
        while len(self._keys) > self._max and self.voxel_m < 1e3:
            self.voxel_m *= 2
            halved = cell_key(cells_of_keys(self._keys) >> 1)
            self._keys, self._rows = _best(halved, self._rows)


def _best(keys: I64, rows: F64) -> tuple[I64, F64]:
    """Of each key the row of most confidence, of equals the first that came; sorted by key."""
    # One sort by whole numbers, and what is left in each group: a third of a sort by all three.
    order = np.argsort(keys)
    for least in (-rows[:, 4], rows[:, 6]):
        first = np.ones(len(order), bool)
        first[1:] = keys[order[1:]] != keys[order[:-1]]
        if first.all():
            break
        own = least[order]
        lowest = np.minimum.reduceat(own, np.flatnonzero(first))
        order = order[own == lowest[np.cumsum(first) - 1]]
    return keys[order], rows[order]


class MapKeeper:
    """A stage's map: given out now and then, forgotten and saved on request.

    Parameters
    ----------
    settings : MapSettings
        Its bounds and its folder.
    frame_id : str
        Frame of the points.

    Attributes
    ----------
    period_s : float, optional
        The map is given at most this often, s of the scan; None: at a flush only.
    """

    def __init__(self, settings: MapSettings, frame_id: str) -> None:
        self.period_s: float | None = PERIOD_S
        self._settings = settings
        self._frame_id = frame_id
        self._map = SurfaceMap(settings.max_points, _VOXEL_M)
        self._changed = self._shown = False
        self._t_ns = 0
        self._given_ns: int | None = None

    def __len__(self) -> int:
        return len(self._map)

    def add(self, patch: Patch, t_ns: int) -> None:
        """Take points of a time, ROS time."""
        self._map.add(patch)
        self._t_ns, self._changed = t_ns, True

    def clear(self) -> None:
        """Forget all; who has seen points is shown that there are none."""
        self._map = SurfaceMap(self._settings.max_points, _VOXEL_M)
        self._changed, self._given_ns = self._shown, None

    def results(self, flush: bool) -> Iterator[Result]:
        """The map as it goes out, if it changed and is due."""
        if self._changed and (flush or self._due()):
            patch = self._map.patch()
            self._changed, self._given_ns, self._shown = False, self._t_ns, len(patch) > 0
            cloud = Cloud(patch.columns(), SURFACE_FIELDS)
            yield Result(None, (Output(SURFACE_MAP, self._t_ns, self._frame_id, cloud),))

    def _due(self) -> bool:
        if self.period_s is None:
            return False
        return self._given_ns is None or self._t_ns - self._given_ns >= self.period_s * 1e9

    def save(self) -> str:
        """Write the map as PLY into its folder, and say where.

        Raises
        ------
        EmptyMapError
            If there is no point yet.
        UnwritableOutputError
            If it can't be written; no file is ever replaced.
        """
        patch = self._map.patch()
        if not len(patch):
            raise EmptyMapError("the map is empty: nothing is saved")
        folder = Path(self._settings.folder).expanduser().absolute()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=folder, prefix=".saving-") as aside:
                part = Path(aside) / "map.ply"
                comment = f"frame {self._frame_id}, metres"
                with PlyWriter(part, SURFACE_PROPERTIES, comment) as ply:
                    ply.write(patch.points, *patch.properties())
                path = _claim(folder, f"map_{datetime.now(UTC):%Y%m%dT%H%M%SZ}")
                part.replace(path)
        except OSError as error:
            raise UnwritableOutputError(f"{folder}: can't be written ({error.strerror})") from error
        return str(path)


def _claim(folder: Path, name: str) -> Path:
    """An empty file that nobody had before."""
    number = 1
    while True:
        path = folder / (f"{name}.ply" if number == 1 else f"{name}_{number}.ply")
        try:
            os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        except FileExistsError:
            number += 1
        else:
            return path
