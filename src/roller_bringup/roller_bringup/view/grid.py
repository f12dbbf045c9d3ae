"""A height map that grows as points come, in tiles, of bounded size."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .hull import cells_in_hull
from .raster import Raster, rasters
from .tiles import TILE, Blocks, Key, Tile, fours, overlapped

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]

#: Tiles at most, of 25 kB (and 16 kB for each further layer); beyond it cells get twice as large.
#: A strip 15 mm wide has cells of 0.1 mm up to 1.4 m, of 0.2 mm up to 4 m, of 0.4 mm up to 16 m.
MOST_TILES = 640
#: States of a cell, as in `height_map.npz`.
OUTSIDE, UNMEASURED, CONTINUED, MEASURED = range(4)
#: A newer point counts at least this much in a cell's mean.
_MOST_WEIGHT = 250
#: Cells along the longer side of what is marked as looked at in one go.
_SLAB = 1024
#: What lies between points and those that came before was looked at if they are this near, m.
_NEAR_M = 0.025
#: Points beyond are none of ours, metres.
_FARTHEST_M = 1e3


class Grid:
    """Cells with the mean of the points that fell into them.

    Cell (i, j) of tile (I, J) has its centre at ((I·64 + i + ½)·`cell_m`, (J·64 + j + ½)·`cell_m`).

    Parameters
    ----------
    cell_m : float
        Edge of a cell at first, metres; it doubles when there are too many tiles.
    most_tiles : int
        Tiles at most.

    Attributes
    ----------
    epoch : str
        Another one whenever all that was given out is void.
    revision : int
        Grows with every change.
    layers : list of str
        Names of the layers beside the state.
    """

    def __init__(self, cell_m: float = 1e-4, most_tiles: int = MOST_TILES) -> None:
        self._first_cell_m = cell_m
        self._most_tiles = most_tiles
        self._values = Blocks((TILE, TILE), np.float32)
        self._bytes = Blocks((2, TILE, TILE), np.uint8)
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self.epoch = secrets.token_hex(4)
        self.cell_m = self._first_cell_m
        self.revision = self.points = 0
        self.layers: list[str] = []
        self.tiles: dict[Key, Tile] = {}
        self._before: I64 | None = None

    @property
    def bounds(self) -> tuple[float, float, float, float] | None:
        """Least x and y and greatest x and y of the tiles, metres."""
        if not self.tiles:
            return None
        keys = np.array(list(self.tiles))
        low, high = keys.min(axis=0), keys.max(axis=0) + 1
        edge = self.cell_m * TILE
        return low[0] * edge, low[1] * edge, high[0] * edge, high[1] * edge

    def covered(self) -> float | None:
        """Share of the cells inside that were measured or continued; None without any."""
        inside, measured = np.sum([tile.counts() for tile in self.tiles.values()] or [(0, 0)], 0)
        return float(measured / inside) if inside else None

    def add(
        self,
        x_m: F64,
        y_m: F64,
        values: Mapping[str, F32],
        state: int | U8 = MEASURED,
        looked_at: bool = True,
    ) -> None:
        """Take points; what is not finite is left out.

        With a height the cells have the mean of all that came, otherwise of these alone.

        Parameters
        ----------
        x_m, y_m : ndarray, shape (n,)
            Places, metres.
        values : mapping of str to ndarray, shape (n,)
            Of each layer.
        state : int or ndarray of uint8, shape (n,)
            Of the cells that they fall into: where there are several, the best.
        looked_at : bool
            Whether what lies between them was looked at.
        """
        sound = (np.abs(x_m) < _FARTHEST_M) & (np.abs(y_m) < _FARTHEST_M)  # not so for NaN
        for column in values.values():
            sound &= np.isfinite(column)
        if not sound.any():
            return
        states = np.asarray(state, np.uint8)
        if not sound.all():
            values = {name: column[sound] for name, column in values.items()}
            x_m, y_m = x_m[sound], y_m[sound]
            states = states[sound] if states.ndim else states
        i, j = (np.floor(v / self.cell_m).astype(np.int64) for v in (x_m, y_m))
        counted = "height" in values
        self.points += len(i) * counted
        self._have(values)
        if looked_at:
            self._mark_hull(i, j)
        for raster in rasters(i, j, values, states, TILE):
            self._take(raster, counted)
        self._shrink()

    def _take(self, new: Raster, counted: bool) -> None:
        for key, here, there in overlapped(new.x0, new.y0, new.count.shape):
            count = new.count[here]
            hit = count > 0
            if not hit.any():
                continue
            tile = self._tile(key)
            weight = tile.weight[there]
            for name, sums in new.sums.items():
                layer, total, points = tile.layers[name][there], sums[here], count
                if counted:  # the weight is that of the height: other layers have the newest
                    before = np.where(np.isfinite(layer), weight, 0)
                    total = total + np.nan_to_num(layer) * before
                    points = count + before
                np.divide(total, points, out=layer, where=hit, casting="same_kind")
            if counted:
                weight[hit] = np.minimum(weight[hit] + count[hit], _MOST_WEIGHT)
            np.maximum(tile.state[there], new.state[here], out=tile.state[there])
            self._touch(tile)

    def put(self, x0: int, y0: int, layers: Mapping[str, F32], state: U8) -> None:
        """Take a whole map at once; cell [j, i] of the arrays is cell (x0 + i, y0 + j) here.

        Parameters
        ----------
        x0, y0 : int
            Cell of the arrays' first element.
        layers : mapping of str to ndarray, shape (ny, nx)
            Values, NaN where there are none.
        state : ndarray of uint8, shape (ny, nx)
            See `OUTSIDE` and its like.
        """
        self._have(layers)
        for key, here, there in overlapped(x0, y0, state.shape):
            part = state[here]
            if not part.any():
                continue
            tile = self._tile(key)
            tile.state[there] = part
            tile.weight[there] = part > UNMEASURED
            for name, values in layers.items():
                tile.layers[name][there] = values[here]
            self._touch(tile)

    def drop_outside(self) -> None:
        """Forget tiles with no cell inside."""
        self.tiles = {key: tile for key, tile in self.tiles.items() if tile.state.any()}

    def changed(self, since: int, most: int) -> tuple[list[tuple[Key, Tile]], int, bool]:
        """Tiles that changed after a revision.

        Parameters
        ----------
        since : int
            The revision.
        most : int
            Tiles at most. Where there are more, they are those with the oldest changes and, again
            and again until it is their turn, a few with the newest: where the scan is now.

        Returns
        -------
        found : list of (tuple of int, Tile)
            The tiles and their keys.
        revision : int
            From where on to ask for the rest.
        more : bool
            Whether there is a rest.
        """
        found = [(key, tile) for key, tile in self.tiles.items() if tile.revision > since]
        found.sort(key=lambda item: item[1].revision)
        if len(found) <= most:
            return found, self.revision, False
        newest = most // 8
        oldest = found[: most - newest]
        return oldest + found[len(found) - newest :], oldest[-1][1].revision, True

    def cells(self, name: str) -> F32:
        """Centres of the cells that were measured, and a layer's value there, shape (n, 3)."""
        out = [np.empty((0, 3), np.float32)]
        for (tx, ty), tile in self.tiles.items():
            if name in tile.layers:
                j, i = np.nonzero((tile.state > UNMEASURED) & np.isfinite(tile.layers[name]))
                x, y = ((t * TILE + k + 0.5) * self.cell_m for t, k in ((tx, i), (ty, j)))
                out.append(np.column_stack([x, y, tile.layers[name][j, i]]).astype(np.float32))
        return np.concatenate(out)

    def _have(self, names: Mapping[str, F32]) -> None:
        new = [name for name in names if name not in self.layers]
        # In one order for the page, whichever topic came first.
        self.layers = sorted([*self.layers, *new], key=lambda name: (name != "height", name))
        for tile in self.tiles.values():
            for name in new:
                tile.layers[name] = self._values.take(np.nan)

    def _tile(self, key: Key) -> Tile:
        if key not in self.tiles:
            empty = {name: self._values.take(np.nan) for name in self.layers}
            self.tiles[key] = Tile(empty, *self._bytes.take(0))
        return self.tiles[key]

    def _touch(self, tile: Tile) -> None:
        """Note a change; each has a number of its own, so who has some can ask for the rest."""
        self.revision += 1
        tile.revision = self.revision

    def _mark_hull(self, i: I64, j: I64) -> None:
        """Mark what lies between points that came together as looked at: the sensor saw it all."""
        corners = _corners(i, j)
        if self._before is not None:
            away = np.maximum(corners.min(axis=0) - self._before.max(axis=0), 0)
            away = np.maximum(away, self._before.min(axis=0) - corners.max(axis=0))
            if away.max() * self.cell_m < _NEAR_M:  # a plain stretch that gave no point
                i, j = np.r_[self._before[:, 0], i], np.r_[self._before[:, 1], j]
        self._before = corners
        # In slabs across the longer side: a patch is one, the map of a long scan is many.
        along = i if np.ptp(i) >= np.ptp(j) else j
        slabs = (along - along.min()) // _SLAB
        pieces: list[Any] = [slice(None)]
        if slabs.any():
            order = np.argsort(slabs, kind="stable")
            pieces = np.split(order, np.flatnonzero(np.diff(slabs[order])) + 1)
        for piece in pieces:
            x0, y0 = int(i[piece].min()), int(j[piece].min())
            mask = cells_in_hull(i[piece] - x0, j[piece] - y0)
            for key, here, there in overlapped(x0, y0, mask.shape):
                tile = self._tile(key)
                np.maximum(tile.state[there], mask[here], out=tile.state[there])
                self._touch(tile)

    def _shrink(self) -> None:
        while len(self.tiles) > self._most_tiles:
            self._double()

    def _double(self) -> None:
        """Cells twice as large: four become one."""
        old, self.tiles, self._before = self.tiles, {}, None
        self.cell_m *= 2
        self.epoch = secrets.token_hex(4)
        while old:  # the new ones take the place of the old
            (tx, ty), tile = old.popitem()
            new = self._tile((tx >> 1, ty >> 1))
            half = TILE // 2
            at = (
                slice((ty & 1) * half, (ty & 1) * half + half),
                slice((tx & 1) * half, (tx & 1) * half + half),
            )
            weight = fours(tile.weight.astype(np.float32))
            new.weight[at] = np.minimum(weight.sum(axis=0), _MOST_WEIGHT)
            new.state[at] = fours(tile.state).max(axis=0)
            for name, layer in tile.layers.items():
                values = fours(layer)
                counts = np.where(np.isfinite(values), np.maximum(weight, 1.0), 0.0)
                total = counts.sum(axis=0)
                sums = (np.nan_to_num(values) * counts).sum(axis=0)
                mean = np.divide(sums, total, out=np.full_like(sums, np.nan), where=total > 0)
                new.layers[name][at] = mean
            self._touch(new)


def _corners(i: I64, j: I64) -> I64:
    """The outermost cells in eight directions, shape (8, 2)."""
    found = [extreme(v) for v in (i, j, i + j, i - j) for extreme in (np.argmin, np.argmax)]
    return np.column_stack([i[found], j[found]])
