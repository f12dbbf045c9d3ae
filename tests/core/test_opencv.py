"""OpenCV works on the thread that calls it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

CODE = """
import cv2
from roller_core.opencv import one_opencv_thread
one_opencv_thread()
print(cv2.getNumThreads())
"""


@pytest.mark.parametrize(("chosen", "threads"), [(None, 1), ("2", 2)])
def test_one_thread_unless_told_otherwise(chosen: str | None, threads: int) -> None:
    name = "OPENCV_FOR_THREADS_NUM"
    environment = {k: v for k, v in os.environ.items() if k != name}
    if chosen is not None:
        environment[name] = chosen
    done = subprocess.run(
        [sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True
    )
    assert int(done.stdout) == threads
