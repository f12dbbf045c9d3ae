"""Memory that is kept for the next window."""

import ctypes
import gc
import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from roller_core.memory import keep_freed_memory, keep_loaded, take_memory


def test_pages_are_not_fetched_again() -> None:
    if not hasattr(ctypes.CDLL(None), "mallopt"):
        pytest.skip("the C library has no mallopt")
    assert keep_freed_memory()
    window(12)
    assert min(window(12) for _ in range(5)) < pages(12) // 4


def test_pages_of_the_first_window_are_taken_ahead() -> None:
    if not keep_freed_memory():
        pytest.skip("the C library has no mallopt")
    take_memory(4)
    assert window(100) < pages(100) // 4


def test_threads_use_what_was_taken_ahead(tmp_path: Path) -> None:
    if not keep_freed_memory():
        pytest.skip("the C library has no mallopt")
    # A library that starts a thread as it is loaded, as some do: the thread that works comes later.
    (tmp_path / "loaded.py").write_text(
        "import resource\n"
        "import threading\n"
        "from roller_core.memory import keep_freed_memory, take_memory\n"
        "def in_thread(work):\n"
        "    thread = threading.Thread(target=work)\n"
        "    thread.start()\n"
        "    thread.join()\n"
        "in_thread(lambda: bytes(100_000))\n"
        "def window():\n"
        "    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt\n"
        "    images = [bytearray(1 << 20) for _ in range(100)]\n"
        "    images.clear()\n"
        "    print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)\n"
        "def main():\n"
        "    keep_freed_memory()\n"
        "    take_memory(4)\n"
        "    in_thread(window)\n"
    )
    code = "from roller_core.signals import load_and_run; load_and_run('loaded')"
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    fetched = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
    )
    assert int(fetched.stdout) < pages(100) // 4


def test_what_is_loaded_is_no_garbage_to_look_through() -> None:
    loaded = [[] for _ in range(1000)]
    try:
        keep_loaded()
        new = {id(each) for each in gc.get_objects()}
        assert not new & {id(each) for each in loaded}
    finally:
        gc.unfreeze()


def pages(mb: int) -> int:
    return mb << 20 >> 12


def window(mb: int) -> int:
    """Pages fetched for images of so many megabytes."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    images = [np.ones(1 << 20, np.uint8) for _ in range(mb)]
    del images
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def test_other_c_libraries_have_nothing_of_the_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes, "CDLL", lambda _: object())
    assert not keep_freed_memory()
