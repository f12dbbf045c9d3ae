"""What kernels ask of an array, in loops of our own.

numba's versions of numpy's have every process that loads such a kernel import scipy's linear
algebra: a tenth of a second. Where one array is assigned to another, numba compiles an error
message and all that it takes of strings: a second or more.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from . import numba_start  # noqa: F401 (before a kernel runs)


@njit(cache=True, nogil=True)
def _copy(values, out):  # type: ignore[no-untyped-def]
    """Write values into an array at least as long."""
    for i in range(len(values)):
        out[i] = values[i]


@njit(cache=True, nogil=True)
def _least(values):  # type: ignore[no-untyped-def]
    """Least of some values, of which none is NaN."""
    found = values[0]
    for i in range(1, len(values)):
        found = min(found, values[i])
    return found


@njit(cache=True, nogil=True)
def _most(values):  # type: ignore[no-untyped-def]
    """Largest of some values, of which none is NaN."""
    found = values[0]
    for i in range(1, len(values)):
        found = max(found, values[i])
    return found


@njit(cache=True, nogil=True)
def _count_up_to(values, limit):  # type: ignore[no-untyped-def]
    """How many of some values that grow are no larger than a limit."""
    low, high = np.int64(0), np.int64(len(values))
    while low < high:
        middle = (low + high) >> 1
        if values[middle] <= limit:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def _median_of_few(values):  # type: ignore[no-untyped-def]
    """Median of a few values, which are sorted for it; NaN of none."""
    n = len(values)
    if n == 0:
        return np.nan
    for i in range(1, n):
        own, k = values[i], i
        while k > 0 and values[k - 1] > own:
            values[k] = values[k - 1]
            k -= 1
        values[k] = own
    if n & 1:
        return values[n >> 1]
    return (values[(n >> 1) - 1] + values[n >> 1]) / 2
