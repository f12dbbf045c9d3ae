"""Libraries of a node work on the thread that calls them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

VARIABLES = ("OPENCV_FOR_THREADS_NUM", "OPENBLAS_NUM_THREADS")
NODE = """
def main():
    import os
    import numpy
    threads = len(os.listdir("/proc/self/task"))
    import cv2
    print(threads, cv2.getNumThreads(), os.environ["OPENBLAS_NUM_THREADS"])
"""
CODE = "from roller_core.signals import load_and_run; load_and_run('a_node')"


@pytest.mark.parametrize(("chosen", "told"), [(None, ["1", "1", "1"]), ("2", ["2", "2"])])
def test_one_thread_unless_told_otherwise(
    tmp_path: Path, chosen: str | None, told: list[str]
) -> None:
    (tmp_path / "a_node.py").write_text(NODE)
    environment = {k: v for k, v in os.environ.items() if k not in VARIABLES}
    environment["PYTHONPATH"] = str(tmp_path)
    if chosen is not None:
        environment |= dict.fromkeys(VARIABLES, chosen)
    done = subprocess.run(
        [sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.split()[-len(told) :] == told
