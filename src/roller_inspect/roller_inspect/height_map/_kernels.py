"""Conjugate gradients for the completion of the surface, without forming the matrix.

Arrays are float64 and C-ordered. `_apply` is the matrix of `completion`'s quadratic form.
"""

from __future__ import annotations

import numba


@numba.njit(cache=True, nogil=True)
def _apply(h, pull, bend, tie_x, tie_y, out):  # type: ignore[no-untyped-def]
    """Write A h into `out` (ny, nx).

    A is diagonal `pull` (ny, nx), plus second differences weighted by `bend` (ny, nx) of the
    middle cell (twice for the mixed one, of the cell with the lowest indices), plus first
    differences weighted by `tie_x` (ny, nx - 1) and `tie_y` (ny - 1, nx).
    """
    ny, nx = h.shape
    for i in range(ny):
        for j in range(nx):
            out[i, j] = pull[i, j] * h[i, j]
    for i in range(ny):
        for j in range(nx):
            w = bend[i, j]
            if 0 < j < nx - 1:
                d = w * (h[i, j - 1] - 2 * h[i, j] + h[i, j + 1])
                out[i, j - 1] += d
                out[i, j] -= 2 * d
                out[i, j + 1] += d
            if 0 < i < ny - 1:
                d = w * (h[i - 1, j] - 2 * h[i, j] + h[i + 1, j])
                out[i - 1, j] += d
                out[i, j] -= 2 * d
                out[i + 1, j] += d
            if j < nx - 1:
                d = tie_x[i, j] * (h[i, j + 1] - h[i, j])
                out[i, j] -= d
                out[i, j + 1] += d
                if i < ny - 1:
                    d = 2 * w * (h[i, j] - h[i, j + 1] - h[i + 1, j] + h[i + 1, j + 1])
                    out[i, j] += d
                    out[i, j + 1] -= d
                    out[i + 1, j] -= d
                    out[i + 1, j + 1] += d
            if i < ny - 1:
                d = tie_y[i, j] * (h[i + 1, j] - h[i, j])
                out[i, j] -= d
                out[i + 1, j] += d


@numba.njit(cache=True, nogil=True)
def _diagonal(pull, bend, tie_x, tie_y, out):  # type: ignore[no-untyped-def]
    """Write the diagonal of the matrix into `out` (ny, nx)."""
    ny, nx = pull.shape
    for i in range(ny):
        for j in range(nx):
            out[i, j] = pull[i, j]
    for i in range(ny):
        for j in range(nx):
            w = bend[i, j]
            if 0 < j < nx - 1:
                out[i, j - 1] += w
                out[i, j] += 4 * w
                out[i, j + 1] += w
            if 0 < i < ny - 1:
                out[i - 1, j] += w
                out[i, j] += 4 * w
                out[i + 1, j] += w
            if j < nx - 1:
                out[i, j] += tie_x[i, j]
                out[i, j + 1] += tie_x[i, j]
                if i < ny - 1:
                    out[i, j] += 2 * w
                    out[i, j + 1] += 2 * w
                    out[i + 1, j] += 2 * w
                    out[i + 1, j + 1] += 2 * w
            if i < ny - 1:
                out[i, j] += tie_y[i, j]
                out[i + 1, j] += tie_y[i, j]


@numba.njit(cache=True, nogil=True)
def _solve(h, right, pull, bend, tie_x, tie_y, tolerance, steps, work):  # type: ignore[no-untyped-def]
    """Solve A h = right in place from a start; `work` (5, ny, nx). Returns the steps taken."""
    ny, nx = h.shape
    residual, turned, way, image, diagonal = work[0], work[1], work[2], work[3], work[4]
    _diagonal(pull, bend, tie_x, tie_y, diagonal)
    _apply(h, pull, bend, tie_x, tie_y, image)
    rho, norm = 0.0, 0.0
    for i in range(ny):
        for j in range(nx):
            residual[i, j] = right[i, j] - image[i, j]
            turned[i, j] = residual[i, j] / diagonal[i, j]
            way[i, j] = turned[i, j]
            rho += residual[i, j] * turned[i, j]
            norm += right[i, j] * right[i, j] / diagonal[i, j]
    for step in range(steps):
        if rho <= tolerance * tolerance * norm or rho == 0.0:
            return step
        _apply(way, pull, bend, tie_x, tie_y, image)
        lift = 0.0
        for i in range(ny):
            for j in range(nx):
                lift += way[i, j] * image[i, j]
        if lift <= 0.0:
            return step
        alpha, before = rho / lift, rho
        rho = 0.0
        for i in range(ny):
            for j in range(nx):
                h[i, j] += alpha * way[i, j]
                residual[i, j] -= alpha * image[i, j]
                turned[i, j] = residual[i, j] / diagonal[i, j]
                rho += residual[i, j] * turned[i, j]
        beta = rho / before
        for i in range(ny):
            for j in range(nx):
                way[i, j] = turned[i, j] + beta * way[i, j]
    return steps
