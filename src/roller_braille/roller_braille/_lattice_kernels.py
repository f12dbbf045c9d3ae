"""Loops over dots that look for the lattice of a line; each has a numpy twin in the tests.

Dots are a few dozen, and hundreds of lattices are tried where other relief lies about: numpy's
calls took ten times as long as what is computed in them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from roller_core import numba_start  # noqa: F401 (before a kernel runs)


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest(along, down, lattice, index, off):  # type: ignore[no-untyped-def]
    """Cell, column and row of the node nearest to each dot, and how far off it lies, metres.

    along, down: float64 (n,), metres; lattice: place of its first node along and down, pitches of
    cells, of dots along and down, cosine and sine of its turn; index: int64 (n, 3); off: float64
    (n,).
    """
    first, top, cell, dot_along, dot_down, c, s = lattice
    for i in range(len(along)):
        x, y = along[i] - first, down[i] - top
        rest, across = c * x + s * y, c * y - s * x
        n = np.floor((rest - dot_along / 2) / cell + 0.5)
        inside = rest - n * cell
        column = 1.0 if inside > dot_along / 2 else 0.0
        row = min(max(np.rint(across / dot_down), 0.0), 2.0)
        index[i, 0], index[i, 1], index[i, 2] = np.int64(n), np.int64(column), np.int64(row)
        off[i] = math.hypot(inside - column * dot_along, across - row * dot_down)


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(along, down, lattice, index, on, pitches, sigma, prior, x):  # type: ignore[no-untyped-def]
    """Change of a lattice that lays it best under the dots on it.

    along, down, lattice, index: as of `_nearest`; on: bool (n,), dots that count; pitches: those
    expected, of cells and dots; sigma: what a dot's place errs by, metres; prior: float64 (6,), how
    much what is looked for may differ; x: float64 (6,), set to offset along, relative change of
    cell and dot pitch, offset down, turn, relative change of the dot pitch down.
    """
    first, top, _, _, _, c, s = lattice
    cell, dot = pitches
    left, right = np.zeros((6, 6)), np.zeros(6)
    for k in range(6):
        left[k, k] = 1.0 / (prior[k] * prior[k])
    a, b = np.zeros(6), np.zeros(6)
    a[0] = b[3] = 1.0 / sigma
    for i in range(len(along)):
        if not on[i]:
            continue
        u, v = along[i] - first, down[i] - top
        rest, across = c * u + s * v, c * v - s * u
        n, column, row = index[i]
        a[1], a[2], a[4] = n * cell / sigma, column * dot / sigma, -across / sigma
        b[4], b[5] = rest / sigma, row * dot / sigma
        lacks = (rest - n * cell - column * dot) / sigma, (across - row * dot) / sigma
        for k in range(6):
            right[k] += a[k] * lacks[0] + b[k] * lacks[1]
            for j in range(k + 1):
                left[k, j] += a[k] * a[j] + b[k] * b[j]
    # Cholesky's method; with a prior the equations always have one solution.
    for k in range(6):
        for j in range(k + 1):
            total = left[k, j]
            for m in range(j):
                total -= left[k, m] * left[j, m]
            left[k, j] = math.sqrt(total) if j == k else total / left[j, j]
    for k in range(6):
        total = right[k]
        for m in range(k):
            total -= left[k, m] * x[m]
        x[k] = total / left[k, k]
    for k in range(5, -1, -1):
        total = x[k]
        for m in range(k + 1, 6):
            total -= left[m, k] * x[m]
        x[k] = total / left[k, k]


@njit(cache=True, nogil=True, error_model="numpy")
def _score_rows(down, weight, top, step, pitches, width, shares, total):  # type: ignore[no-untyped-def]
    """Add up the dots near three rows, by the place of the top one and their pitch.

    down, weight: float64 (n,), place down the image, metres, and what a dot counts; top: float64
    (k,), places `step` apart; pitches: float64 (p,); width: half of what is near, metres; shares:
    float64 (3,), what a row counts; total: float64 (k, p), zero.
    """
    last = len(top) - 1
    for p in range(len(pitches)):
        for row in range(3):
            for i in range(len(down)):
                place = down[i] - row * pitches[p]
                begin = max(math.ceil((place - 2 * width - top[0]) / step), 0)
                end = min(math.floor((place + 2 * width - top[0]) / step), last)
                for k in range(begin, end + 1):
                    near = max(1.0 - abs(top[k] - place) / (2 * width), 0.0)
                    total[k, p] += shares[row] * weight[i] * near


@njit(cache=True, nogil=True, error_model="numpy")
def _score_cells(along, weight, start, cells, dot, width, shares, total):  # type: ignore[no-untyped-def]
    """Add up the dots near the two columns of cells, by the place of the first and the pitch.

    along, weight: float64 (n,), place from the first dot, metres, and what a dot counts; start:
    float64 (k,); cells: float64 (c,); dot: pitch of dots, metres; width: half of what is near,
    metres; shares: what a dot on either column counts; total: float64 (k, c), zero.
    """
    for k in range(len(start)):
        for p in range(len(cells)):
            cell = cells[p]
            for i in range(len(along)):
                rest = (along[i] - start[k]) / cell
                rest = (rest - np.floor(rest)) * cell
                # The next cell's first column, and the second one of the cell before.
                first = min(rest, abs(rest - cell))
                second = min(abs(rest - dot), min(abs(rest - dot - cell), rest + cell - dot))
                a = max(1.0 - first / (2 * width), 0.0) * shares[0]
                b = max(1.0 - second / (2 * width), 0.0) * shares[1]
                total[k, p] += max(a, b) * weight[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _score_turns(along, down, weight, apart, cosines, sines, width, score):  # type: ignore[no-untyped-def]
    """Add up the pairs of dots that lie in a row, by its turn.

    along, down, weight: float64 (n,); apart: distance from which on a pair counts, metres; cosines,
    sines: float64 (k,); width: how far dots may lie beside each other, metres; score: float64 (k,),
    zero.
    """
    for i in range(len(along)):
        for j in range(i + 1, len(along)):
            x, y = along[j] - along[i], down[j] - down[i]
            if math.hypot(x, y) <= apart:
                continue
            both = weight[i] * weight[j]
            for k in range(len(score)):
                beside = abs(cosines[k] * y - sines[k] * x)
                score[k] += max(1.0 - beside / width, 0.0) * both
