"""OpenCV's own threads, which get in the way of ours."""

from __future__ import annotations

import os

_VARIABLE = "OPENCV_FOR_THREADS_NUM"


def one_opencv_thread() -> None:
    """Have OpenCV do its work on the thread that calls it, unless the environment says otherwise.

    What there is to do is shared between threads and processes already. OpenCV would share it out
    once more, image by image: that costs 7 % of a window's CPU time and gains none. To be called
    before OpenCV is first used.
    """
    os.environ.setdefault(_VARIABLE, "1")
