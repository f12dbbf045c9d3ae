"""numba, ready without scipy.linalg.

numba loads scipy.linalg (a third of a second of every process) to see whether kernels could
multiply matrices by BLAS. None of ours does; what needs scipy.linalg loads it as ever. To be
imported by the packages' first kernels, before one of them runs.
"""

from __future__ import annotations

import sys
from importlib import import_module

_WANTED = "scipy.linalg.cython_blas"


def _load() -> None:
    if _WANTED in sys.modules:
        return
    modules: dict[str, object] = sys.modules  # type: ignore[assignment]  # None: there is none
    modules[_WANTED] = None
    try:
        import_module("numba.np.arraymath")
    finally:
        del modules[_WANTED]


_load()
