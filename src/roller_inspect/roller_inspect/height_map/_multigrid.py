"""Conjugate gradients with a multigrid preconditioner, without forming the matrix.

The matrix A is that of `completion`'s quadratic form. Its parts are `pull` (ny, nx) on the
diagonal, second differences weighted by `bend` (ny, nx) of the middle cell (twice for the mixed
one, of the cell with the lowest indices), and first differences weighted by `tie_x` (ny, nx - 1)
and `tie_y` (ny - 1, nx). Arrays are C-ordered and all of one type: float64, or float32, which
takes less time.

Each coarser level has the same parts on cells twice as large. Smoother: two steps of Chebyshev's
iteration (Adams et al., Parallel multigrid smoothing, 2003).
"""

from __future__ import annotations

import numba
import numpy as np

from roller_core._array_kernels import _copy

#: Sums may be reordered; nothing here is NaN or infinite.
_SUMS = {"reassoc", "contract", "nsz"}
#: What a coarse cell takes of the sums of `pull`, `bend` and both ties.
_SHARES = 1.0, 1 / 16, 1 / 4, 1 / 4
#: No eigenvalue of A over its diagonal is larger: that of a mixed difference, of a second one it
#: is 3. The smoother takes away from this to an eighth of it; on the coarsest level to a 60th.
_MOST, _SMOOTH, _COARSEST, _COARSEST_STEPS = 4.0, 8.0, 60.0, 8


@numba.njit(cache=True, nogil=True, fastmath=_SUMS)
def _apply(h, pull, bend, tie_x, tie_y, lines, out):  # type: ignore[no-untyped-def]
    """Write A h into `out` (ny, nx); `lines` (3, nx + 2) or wider is scratch.

    Each loop writes one row, so that it runs on several cells at once.
    """
    ny, nx = h.shape
    # Of a row: its second differences, and what flows from each cell to the next; mixed ones.
    second, flow, mixed = lines[0], lines[1], lines[2]
    second[0], second[nx + 1], flow[0], flow[nx], mixed[0], mixed[nx] = 0, 0, 0, 0, 0, 0
    out[0] = 0
    for i in range(ny):
        here, w, own = h[i], bend[i], out[i]
        second[1], second[nx] = 0, 0
        for j in range(1, nx - 1):
            second[j + 1] = w[j] * (here[j - 1] - here[j] + (here[j + 1] - here[j]))
        for j in range(nx - 1):
            flow[j + 1] = tie_x[i, j] * (here[j + 1] - here[j]) + second[j + 1] - second[j + 2]
        for j in range(nx):
            own[j] += pull[i, j] * here[j] + flow[j] - flow[j + 1]
        if i == ny - 1:
            continue
        below, under = h[i + 1], out[i + 1]
        for j in range(nx - 1):
            mixed[j + 1] = (w[j] + w[j]) * (here[j] - here[j + 1] - below[j] + below[j + 1])
        for j in range(nx):
            under[j] = mixed[j] - mixed[j + 1] + tie_y[i, j] * (below[j] - here[j])
        for j in range(nx):
            own[j] -= under[j]
        if i > 0:
            above, over = h[i - 1], out[i - 1]
            for j in range(nx):
                second[j] = w[j] * (above[j] - here[j] + (below[j] - here[j]))
            for j in range(nx):
                over[j] += second[j]
            for j in range(nx):
                own[j] -= second[j] + second[j]
            for j in range(nx):
                under[j] += second[j]
            second[0] = 0


@numba.njit(cache=True, nogil=True, fastmath=_SUMS)
def _scale(pull, bend, tie_x, tie_y, lines, out):  # type: ignore[no-untyped-def]
    """Write one over the diagonal of A into `out` (ny, nx); `lines` as for `_apply`."""
    ny, nx = pull.shape
    second, mixed, across = lines[0], lines[1], lines[2]
    second[0], second[1], second[nx], second[nx + 1] = 0, 0, 0, 0
    mixed[0], mixed[nx], across[0], across[nx] = 0, 0, 0, 0
    for i in range(ny):
        _copy(pull[i], out[i])
    for i in range(ny):
        w, own = bend[i], out[i]
        # A difference counts with its factor's square: 1, 4 and 1 of a second one.
        for j in range(1, nx - 1):
            second[j + 1] = w[j]
        for j in range(nx - 1):
            across[j + 1] = tie_x[i, j]
        for j in range(nx):
            own[j] += second[j] + 4 * second[j + 1] + second[j + 2] + across[j] + across[j + 1]
        if i == ny - 1:
            continue
        under = out[i + 1]
        for j in range(nx - 1):
            mixed[j + 1] = w[j] + w[j]
        for j in range(nx):
            both = mixed[j] + mixed[j + 1] + tie_y[i, j]
            own[j] += both
            under[j] += both
        if i > 0:
            over = out[i - 1]
            for j in range(nx):
                over[j] += w[j]
            for j in range(nx):
                own[j] += 4 * w[j]
            for j in range(nx):
                under[j] += w[j]
    for i in range(ny):
        for j in range(nx):
            out[i, j] = 1 / out[i, j]


@numba.njit(cache=True, nogil=True, fastmath=_SUMS)
def _weigh(h, z, weight, sigma, most, hardest, tie, slope, pull, pulled, tie_x, tie_y):  # type: ignore[no-untyped-def]
    """Write the weights that cells and slopes have at h.

    `pull`: of each cell's height z, `weight` / `sigma`² and less beyond `most` σ (Huber), at most
    `hardest`; `pulled`: times z. `tie_x`, `tie_y`: `tie` / sqrt(1 + s²) of the difference times
    `slope`.
    """
    ny, nx = h.shape
    one = h.dtype.type(1)
    for i in range(ny):
        for j in range(nx):
            far = abs(h[i, j] - z[i, j])
            bound = most * sigma[i, j]
            own = weight[i, j] / (sigma[i, j] * sigma[i, j])
            pull[i, j] = min(own * bound / max(far, bound), hardest)
            pulled[i, j] = pull[i, j] * z[i, j]
        for j in range(nx - 1):
            s = (h[i, j + 1] - h[i, j]) * slope
            tie_x[i, j] = tie / np.sqrt(one + s * s)
        if i < ny - 1:
            for j in range(nx):
                s = (h[i + 1, j] - h[i, j]) * slope
                tie_y[i, j] = tie / np.sqrt(one + s * s)


@numba.njit(cache=True, nogil=True)
def _coarsen(fine, out, share):  # type: ignore[no-untyped-def]
    """Write `share` of the sums over two by two cells into `out`; cells beyond the last are none.

    `out` may be smaller than half of `fine`: ties have no coarse one at their end.
    """
    ny, nx = fine.shape
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = fine[2 * i, 2 * j]
            right, below = 2 * j + 1 < nx, 2 * i + 1 < ny
            if right:
                total += fine[2 * i, 2 * j + 1]
            if below:
                total += fine[2 * i + 1, 2 * j]
            if right and below:
                total += fine[2 * i + 1, 2 * j + 1]
            out[i, j] = share * total


@numba.njit(cache=True, nogil=True)
def _restrict(fine, line, out):  # type: ignore[no-untyped-def]
    """Write the transpose of `_prolong` times `fine` into `out`; `line` as wide as `fine`."""
    (ny, nx), (my, mx) = fine.shape, out.shape
    near, far = fine.dtype.type(0.75), fine.dtype.type(0.25)
    for i in range(my):
        a, b, c, d = max(2 * i - 1, 0), 2 * i, 2 * i + 1, 2 * i + 2
        last = c >= ny
        # Beyond an edge lies the edge; past an odd end, nothing.
        c, d = min(c, ny - 1), min(d, ny - 1)
        below = fine.dtype.type(0) if last else near
        beyond = fine.dtype.type(0) if last else far
        for j in range(nx):
            line[j] = (
                far * fine[a, j] + near * fine[b, j] + below * fine[c, j] + beyond * fine[d, j]
            )
        for j in range(mx):
            total = far * line[max(2 * j - 1, 0)] + near * line[2 * j]
            if 2 * j + 1 < nx:
                total += near * line[2 * j + 1] + far * line[min(2 * j + 2, nx - 1)]
            out[i, j] = total


@numba.njit(cache=True, nogil=True)
def _prolong(coarse, line, out):  # type: ignore[no-untyped-def]
    """Add heights linear between the centres of coarse cells to `out`; `line` as wide as it."""
    (ny, nx), (my, mx) = out.shape, coarse.shape
    near, far = out.dtype.type(0.75), out.dtype.type(0.25)
    for i in range(ny):
        at = i // 2
        to = min(at + 1, my - 1) if i % 2 else max(at - 1, 0)
        for j in range(mx):
            line[j] = near * coarse[at, j] + far * coarse[to, j]
        for j in range(mx):
            out[i, 2 * j] += near * line[j] + far * line[max(j - 1, 0)]
        for j in range(nx // 2):
            out[i, 2 * j + 1] += near * line[j] + far * line[min(j + 1, mx - 1)]


@numba.njit(cache=True, nogil=True, fastmath=_SUMS)
def _smooth(x, right, parts, image, way, lines, steps, least, begun):  # type: ignore[no-untyped-def]
    """Chebyshev's iteration on A x = right, in place, for eigenvalues above `_MOST` / `least`.

    It starts from x, or from zero if it hasn't `begun`. `parts` are A's and one over its diagonal.
    """
    pull, bend, tie_x, tie_y, scale = parts
    ny, nx = x.shape
    kind = x.dtype.type
    low = _MOST / least
    middle, half = (_MOST + low) / 2, (_MOST - low) / 2
    rho, on, by = half / middle, kind(0), kind(1 / middle)
    for step in range(steps):
        if step == 0 and not begun:
            for i in range(ny):
                for j in range(nx):
                    way[i, j] = by * scale[i, j] * right[i, j]
                    x[i, j] = way[i, j]
        else:
            _apply(x, pull, bend, tie_x, tie_y, lines, image)
            for i in range(ny):
                for j in range(nx):
                    way[i, j] = on * way[i, j] + by * scale[i, j] * (right[i, j] - image[i, j])
                    x[i, j] += way[i, j]
        after = 1 / (2 * middle / half - rho)
        on, by, rho = kind(after * rho), kind(2 * after / half), after


@numba.njit(cache=True, nogil=True, fastmath=_SUMS)
def _cycle(levels, x, right, image, way, lines):  # type: ignore[no-untyped-def]
    """One V-cycle on A x = right: into x[0] from right[0]; all but `lines` by level."""
    last = len(x) - 1
    # Down and up again in one loop: what it calls is compiled once for each place it is called at.
    for visit in range(2 * last + 1):
        k, up = min(visit, 2 * last - visit), visit > last
        if up:
            _prolong(x[k + 1], lines[0], x[k])
        steps, least = (_COARSEST_STEPS, _COARSEST) if visit == last else (2, _SMOOTH)
        _smooth(x[k], right[k], levels[k], image[k], way[k], lines, steps, least, up)
        if visit < last:
            pull, bend, tie_x, tie_y, _ = levels[k]
            _apply(x[k], pull, bend, tie_x, tie_y, lines, image[k])
            for i in range(x[k].shape[0]):
                for j in range(x[k].shape[1]):
                    image[k][i, j] = right[k][i, j] - image[k][i, j]
            _restrict(image[k], lines[0], right[k + 1])


@numba.njit(cache=True, nogil=True, fastmath=_SUMS)
def _advance(h, parts, residual, turned, spread, ahead, lines, before):  # type: ignore[no-untyped-def]
    """Go a step of conjugate gradients.

    `turned` is the residual after a cycle, `before` the product of both in the step before. Returns
    that product now, and whether there was a way ahead.
    """
    pull, bend, tie_x, tie_y, _ = parts
    ny, nx = h.shape
    kind = h.dtype.type
    rho = kind(0)
    for i in range(ny):
        for j in range(nx):
            rho += residual[i, j] * turned[i, j]
    beta = rho / before
    for i in range(ny):
        for j in range(nx):
            ahead[i, j] = turned[i, j] + beta * ahead[i, j]
    _apply(ahead, pull, bend, tie_x, tie_y, lines, spread)
    lift = kind(0)
    for i in range(ny):
        for j in range(nx):
            lift += ahead[i, j] * spread[i, j]
    if lift <= 0:
        return rho, False
    alpha = rho / lift
    for i in range(ny):
        for j in range(nx):
            h[i, j] += alpha * ahead[i, j]
            residual[i, j] -= alpha * spread[i, j]
    return rho, True


def solve(  # type: ignore[no-untyped-def]
    h, pulled, levels, x, right, image, way, ahead, lines, enough, steps
) -> int:
    """Solve A h = `pulled` in place from a start. Returns the steps taken.

    `h`, `pulled`, `ahead` (ny, nx) and `lines` (3, nx + 2), the last two scratch. `levels` is a
    tuple by level, each (ny, nx) halved and rounded up, of `pull`, `bend`, `tie_x`, `tie_y` and
    one over A's diagonal; the first level's four are given, all else is made here. `x`, `right`,
    `image`, `way`: scratch by level. It ends when the square of the error before a step,
    in the matrix's own measure, was `enough` or less.

    No kernel itself: all that it calls would be compiled into it once more, for seconds.
    """
    for k, (pull, bend, tie_x, tie_y, scale) in enumerate(levels):
        if k:
            # Differences over twice the distance: first ones double, second ones four times.
            for fine, coarse, share in zip(levels[k - 1], levels[k], _SHARES, strict=False):
                _coarsen(fine, coarse, h.dtype.type(share))
        _scale(pull, bend, tie_x, tie_y, lines, scale)
    _apply(h, *levels[0][:4], lines, image[0])
    np.subtract(pulled, image[0], out=right[0])
    ahead[:] = 0
    rho = h.dtype.type(1)
    for step in range(steps):
        _cycle(levels, x, right, image, way, lines)
        rho, goes_on = _advance(
            h, levels[0], right[0], x[0], image[0], ahead, lines, h.dtype.type(rho)
        )
        if not goes_on:
            return step
        if rho <= enough:
            return step + 1
    return int(steps)
