"""numba, ready for cached kernels without what only compiling needs.

Before it loads a kernel from its cache, numba sets up the types of all that a kernel could call
and loads scipy.linalg to see whether one could multiply matrices: half a second of every process.
A compiled kernel needs none of it, and what compiles sets it up as ever. To be imported by the
packages' first kernels, before one of them runs.
"""

from __future__ import annotations

from typing import Any

from numba.core.caching import Cache
from numba.core.runtime import rtsys


def _load_overload(self: Any, sig: Any, target_context: Any) -> Any:
    """Load a compiled kernel, or None; numba's own method without `target_context.refresh`."""
    rtsys.initialize(target_context)
    with self._guard_against_spurious_io_errors():
        return self._load_overload(sig, target_context)


Cache.load_overload = _load_overload
