"""Memory that is used again from window to window."""

from __future__ import annotations

import ctypes

#: Parameters of glibc's mallopt (malloc.h), and what they are set to, bytes.
_TRIM_THRESHOLD, _KEPT = -1, 128 << 20
_MMAP_THRESHOLD, _FROM_SYSTEM = -3, 32 << 20


def keep_freed_memory() -> bool:
    """Have the C library keep what is freed, for the next window.

    Every window takes images and rays of the same sizes. By default glibc hands blocks of that
    size back to the system, and touching fresh pages costs more than what is computed in them,
    on virtual machines above all.

    Returns
    -------
    bool
        Whether it was done; other C libraries have nothing of the kind.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):
        return False
    return bool(mallopt(_TRIM_THRESHOLD, _KEPT)) and bool(mallopt(_MMAP_THRESHOLD, _FROM_SYSTEM))
