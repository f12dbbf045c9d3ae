"""Memory that is kept for the next window."""

import ctypes
import resource

import numpy as np
import pytest

from roller_core.memory import keep_freed_memory, take_memory


def test_pages_are_not_fetched_again() -> None:
    if not hasattr(ctypes.CDLL(None), "mallopt"):
        pytest.skip("the C library has no mallopt")
    assert keep_freed_memory()
    window(12)
    assert min(window(12) for _ in range(5)) < pages(12) // 4


def test_pages_of_the_first_window_are_taken_ahead() -> None:
    if not keep_freed_memory():
        pytest.skip("the C library has no mallopt")
    take_memory()
    assert window(100) < pages(100) // 4


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
