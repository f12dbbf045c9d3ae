"""numba, ready for cached kernels: none of older code, and nothing that only compiling needs.

numba's cache keeps a kernel until its file changes. What the kernel calls or reads of other files
is compiled into it, so here a digest of all that belongs to what the cache is held to.

Before it loads a kernel from its cache, numba sets up the types of all that a kernel could call
and loads scipy.linalg to see whether one could multiply matrices: half a second of every process.
A compiled kernel needs none of it, and what compiles sets it up as ever. To be imported by the
packages' first kernels, before one of them runs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core.caching import Cache
from numba.core.dispatcher import Dispatcher
from numba.core.runtime import rtsys

#: Values of modules that are compiled into a kernel, and tuples of them.
_CONSTANTS = (bool, int, float, complex, str, np.generic)


@cache
def kernel_digest(function: FunctionType) -> str:
    """Digest of a kernel's code, of all that it calls, and of the constants that these read.

    Parameters
    ----------
    function : function
        The kernel as it was before it was compiled (`py_func`).
    """
    found, seen, left = hashlib.sha256(), {function}, [function]
    while left:
        kernel, names = left.pop(), set[str]()
        for each in _codes(kernel.__code__):
            plain = [_plain(c) for c in each.co_consts if not isinstance(c, CodeType)]
            found.update(each.co_code + repr((each.co_names, each.co_varnames, plain)).encode())
            names.update(each.co_names)
        for name, value in _read(kernel.__globals__, names):
            if isinstance(value, Dispatcher):
                options = [(k, _plain(v)) for k, v in sorted(value.targetoptions.items())]
                found.update(repr((name, options)).encode())
                value = value.py_func
            if not isinstance(value, FunctionType):
                found.update(repr((name, value)).encode())
            elif value not in seen:
                seen.add(value)
                left.append(value)
    return found.hexdigest()


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code and that of the functions within."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _read(of: dict[str, Any], names: set[str]) -> Iterator[tuple[str, Any]]:
    """Functions, kernels and constants of a module that code reads, and those of its modules."""
    for name in sorted(names & of.keys()):
        value = of[name]
        if isinstance(value, (Dispatcher, FunctionType)) or _is_constant(value):
            yield name, value
        elif isinstance(value, ModuleType):
            for part in sorted(names & vars(value).keys()):
                own = vars(value)[part]
                if isinstance(own, Dispatcher) or _is_constant(own):
                    yield f"{name}.{part}", own


def _is_constant(value: object) -> bool:
    if isinstance(value, tuple):
        return all(map(_is_constant, value))
    return isinstance(value, _CONSTANTS)


def _plain(value: object) -> object:
    """The same in every process: sets have no order of their own."""
    return sorted(map(repr, value)) if isinstance(value, (set, frozenset)) else value


def _load_overload(self: Any, sig: Any, target_context: Any) -> Any:
    """Load a compiled kernel that is up to date, or None.

    numba's own method, without `target_context.refresh` and with the digest. It is called before a
    kernel is saved, too.
    """
    rtsys.initialize(target_context)
    stamp = self._impl.locator.get_source_stamp()
    self._cache_file._source_stamp = (stamp, kernel_digest(self._py_func))
    with self._guard_against_spurious_io_errors():
        return self._load_overload(sig, target_context)


Cache.load_overload = _load_overload
