"""Threads that libraries start on their own, which get in the way of ours."""

from __future__ import annotations

import os

#: What OpenCV, and the BLAS under numpy and scipy, take the number of their threads from.
_VARIABLES = ("OPENCV_FOR_THREADS_NUM", "OPENBLAS_NUM_THREADS")


def one_thread_a_library() -> None:
    """Have libraries work on the thread that calls them, unless the environment says otherwise.

    What there is to do is shared between threads and processes already. OpenCV would share it out
    once more, image by image: that costs 7 % of a window's CPU time and gains none. So would BLAS
    with products of thousands of points by a matrix of 3 × 3, whose threads then wait for each
    other: half of the stitcher's CPU time. To be called before numpy and OpenCV are loaded.
    """
    for name in _VARIABLES:
        os.environ.setdefault(name, "1")
