"""Squares of cells, and their memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
U8 = npt.NDArray[np.uint8]

#: Cells along a tile's edge.
TILE = 64
#: Tiles whose arrays are taken from the system together, half a megabyte at least.
_BLOCKS = 64

Key = tuple[int, int]
Slices = tuple[slice, slice]


@dataclass
class Tile:
    """Cells of a square; `revision` is that of its last change."""

    layers: dict[str, F32]
    state: U8
    weight: U8
    revision: int = 0
    _counted: tuple[int, int, int] = (-1, 0, 0)

    def counts(self) -> tuple[int, int]:
        """Cells inside, and those of them that were measured or continued."""
        if self._counted[0] != self.revision:
            of_state = np.bincount(self.state.ravel(), minlength=4)
            self._counted = (self.revision, int(of_state[1:].sum()), int(of_state[2:].sum()))
        return self._counted[1:]


class Blocks:
    """Arrays out of large ones, which the system has back at once when all in them are gone."""

    def __init__(self, shape: tuple[int, ...], kind: npt.DTypeLike) -> None:
        self._shape, self._kind = shape, kind
        self._rest: list[npt.NDArray[Any]] = []

    def take(self, value: float) -> npt.NDArray[Any]:
        """One that holds a value everywhere."""
        if not self._rest:
            self._rest = list(np.empty((_BLOCKS, *self._shape), self._kind)[::-1])
        block = self._rest.pop()
        block.fill(value)
        return block


def fours(values: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """The four cells that become one, shape (4, n / 2, n / 2)."""
    half = TILE // 2
    return values.reshape(half, 2, half, 2).transpose(1, 3, 0, 2).reshape(4, half, half)


def overlapped(x0: int, y0: int, shape: tuple[int, ...]) -> Iterator[tuple[Key, Slices, Slices]]:
    """Tiles that an array of cells lies over, and where they overlap in the array and the tile."""
    height, width = shape
    for ty in range(y0 // TILE, (y0 + height - 1) // TILE + 1):
        rows, there_y = _overlap(ty, y0, height)
        for tx in range(x0 // TILE, (x0 + width - 1) // TILE + 1):
            columns, there_x = _overlap(tx, x0, width)
            yield (tx, ty), (rows, columns), (there_y, there_x)


def _overlap(tile: int, first: int, count: int) -> tuple[slice, slice]:
    """Where a row of tiles and `count` cells from `first` on overlap: in the cells, in the tile."""
    begin = max(tile * TILE, first)
    end = min((tile + 1) * TILE, first + count)
    return slice(begin - first, end - first), slice(begin - tile * TILE, end - tile * TILE)


def pack(found: Sequence[tuple[Key, Tile]], names: Sequence[str]) -> list[memoryview]:
    """Tiles as blocks: of each its layers (64 × 64 float32), then its state (64 × 64 uint8)."""
    blocks: list[memoryview] = []
    for _, tile in found:
        blocks += [tile.layers[name].data for name in names]
        blocks.append(tile.state.data)
    return blocks
