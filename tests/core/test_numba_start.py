import importlib
import sys

import numba
import pytest

from roller_core.numba_start import kernel_digest

_CALLER = """
from numba import njit
{read}

@njit(cache=True)
def area(side):
    return {called}(side) * {constant}
"""
_CALLEE = """
from numba import njit

SHARE = {share}

@njit(fastmath={{"contract", "reassoc"}})
def square(side):
    return {body}
"""
_WAYS = {
    "names": ("from callee_of_kernels import SHARE, square", "square", "SHARE"),
    "module": ("import callee_of_kernels as other", "other.square", "other.SHARE"),
}


@pytest.fixture(params=_WAYS)
def load(request, tmp_path, monkeypatch):
    """Write what a kernel calls, and load both anew, as another process would."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    read, called, constant = _WAYS[request.param]
    text = _CALLER.format(read=read, called=called, constant=constant)
    (tmp_path / "caller_of_kernels.py").write_text(text)

    def again(body="side * side", share=1):
        (tmp_path / "callee_of_kernels.py").write_text(_CALLEE.format(body=body, share=share))
        for name in ("caller_of_kernels", "callee_of_kernels"):
            sys.modules.pop(name, None)
        monkeypatch.setattr(sys, "dont_write_bytecode", True)
        importlib.invalidate_caches()
        return importlib.import_module("caller_of_kernels").area

    yield again
    for name in ("caller_of_kernels", "callee_of_kernels"):
        sys.modules.pop(name, None)


def test_a_cached_kernel_follows_what_it_calls_and_reads_of_other_files(load):
    first = load()
    assert first(3) == 9
    same = load()
    assert same(3) == 9
    assert sum(same.stats.cache_hits.values()) == 1
    assert load(body="side * side + 1")(3) == 10
    assert load(body="side * side + 1", share=2)(3) == 20
    last = load(body="side * side + 1", share=2)
    assert last(3) == 20
    assert sum(last.stats.cache_hits.values()) == 1


def test_a_digest_is_the_same_in_every_process_that_reads_the_same(load):
    assert kernel_digest(load().py_func) == kernel_digest(load().py_func)
    assert kernel_digest(load().py_func) != kernel_digest(load(share=3).py_func)
