"""Memory that is kept for the next window."""

import ctypes
import resource

import numpy as np
import pytest

from roller_core.memory import keep_freed_memory


def test_pages_are_not_fetched_again() -> None:
    if not hasattr(ctypes.CDLL(None), "mallopt"):
        pytest.skip("the C library has no mallopt")
    assert keep_freed_memory()
    pages = 12 << 20 >> 12

    def window() -> int:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        images = [np.ones(1 << 20, np.uint8) for _ in range(12)]
        del images
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

    window()
    assert min(window() for _ in range(5)) < pages // 4


def test_other_c_libraries_have_nothing_of_the_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes, "CDLL", lambda _: object())
    assert not keep_freed_memory()
