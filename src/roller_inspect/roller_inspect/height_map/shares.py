"""How much of coarse cells was measured: their states say only what most of each is."""

from __future__ import annotations

import numpy as np

from .height_map import CONTINUED, F32, MEASURED, U8, UNMEASURED, HeightMap
from .join import block_means, window_of

#: What was measured and compared with nothing: beside the states of cells, for shares alone.
BARE = MEASURED + 1
#: States that have a share, in its order; the rest of a cell is outside.
STATES = (UNMEASURED, CONTINUED, MEASURED, BARE)
#: Shares of cells that lie beside each other add up to no more than one, but for rounding.
_WHOLE = 1.0 + 1e-4


def inspected_states(height_map: HeightMap, deviation_m: F32 | None) -> U8:
    """States of cells; those that were compared with nothing are unmeasured.

    Where nothing at all was compared states are as they are: the reference is at fault.
    """
    if deviation_m is None or not np.isfinite(deviation_m).any():
        return height_map.state
    bare = height_map.known & ~np.isfinite(deviation_m)
    return np.where(bare, np.uint8(UNMEASURED), height_map.state)


def shares_of(height_map: HeightMap, deviation_m: F32 | None) -> F32:
    """Shares of each cell by its state: all or none. Shape (4, ny, nx)."""
    state = inspected_states(height_map, deviation_m)
    bare = (height_map.state == MEASURED) & (state != MEASURED)
    state = np.where(bare, np.uint8(BARE), state)
    return np.stack([state == one for one in STATES]).astype(np.float32)


def measured_cells(state: U8, shares: F32 | None) -> float:
    """How many cells were measured, whatever they were compared with.

    Parameters
    ----------
    state : ndarray of uint8, shape (n,)
        Of the map, of some cells.
    shares : ndarray of float32, shape (4, n), optional
        Of the same cells.
    """
    if shares is None:
        return float((state == MEASURED).sum())
    return float(shares[STATES.index(MEASURED) :].sum(dtype=np.float64))


def coarser_shares(height_map: HeightMap, shares: F32, factor: int) -> F32:
    """Shares on a map with cells so many times as long and wide."""
    if factor <= 1:
        return shares
    return np.stack([block_means(height_map, plane, factor) for plane in shares])


def joined_shares(whole: HeightMap, pieces: list[HeightMap], shares: list[F32]) -> F32:
    """Shares on the map that some were joined to.

    Of cells that two pieces have each a part of they add up; where pieces overlap those of what
    is known best count.
    """
    out = np.zeros((len(STATES), *whole.shape), np.float32)
    state = np.zeros(whole.shape, np.uint8)
    for piece, own in zip(pieces, shares, strict=True):
        place = window_of(whole, piece)
        into = out[:, place[0], place[1]]
        had, new = into.sum(axis=0), own.sum(axis=0)
        beside = had + new <= _WHOLE
        better = (piece.state >= state[place]) & (new >= had) & ~beside
        np.add(into, own, out=into, where=beside)
        np.copyto(into, own, where=better)
        np.maximum(state[place], piece.state, out=state[place])
    return out
