"""Memory that is used again from window to window."""

from __future__ import annotations

import ctypes
import gc

#: Parameters of glibc's mallopt (malloc.h), and what they are set to, bytes.
_TRIM_THRESHOLD, _KEPT = -1, 192 << 20
_MMAP_THRESHOLD, _FROM_SYSTEM = -3, 32 << 20
#: One heap for all threads, as each keeps what was freed in it. Threads allocate large arrays, and
#: too seldom to wait for one another.
_ARENA_MAX, _ARENAS = -8, 1
#: Size of what is taken ahead at once, bytes: below both limits.
_AHEAD = 30 << 20
#: The same where memory counts for more.
_KEPT_WHEN_SMALL, _FROM_SYSTEM_WHEN_SMALL = 1 << 20, 512 << 10
#: New objects after which Python looks for garbage; by default it does after 700.
_NEW_OBJECTS = 50_000


def keep_freed_memory() -> bool:
    """Have the C library keep what is freed, for the next window.

    Every window takes images and rays of the same sizes. By default glibc hands blocks of that
    size back to the system, and touching fresh pages costs more than what is computed in them,
    on virtual machines above all.

    To be called before any thread starts, and so before numpy and rclpy are loaded: a thread that
    is there already has a heap of its own, which later threads take over, and what
    `take_memory` took lies idle in another.

    Returns
    -------
    bool
        Whether it was done; other C libraries have nothing of the kind.
    """
    return _set(_KEPT, _FROM_SYSTEM)


def take_memory(blocks: int) -> None:
    """Take from the system, ahead of the first window, what `keep_freed_memory` keeps.

    Touching it for the first time takes as long as half a window's work.

    Parameters
    ----------
    blocks : int
        How much, in 30 MB.
    """
    taken = [b"\1" * _AHEAD for _ in range(blocks)]
    taken.clear()


def collect_seldom() -> None:
    """Have Python look for garbage seldom: before libraries are loaded.

    They make hundreds of thousands of objects that stay. Looking among them after every 700 takes
    a tenth of a short command's time.
    """
    gc.set_threshold(_NEW_OBJECTS)


def keep_loaded() -> None:
    """Have Python look for garbage only among what is made from now on.

    To be called when all is loaded. Looking through all that holds every thread of a node up for a
    tenth of a second, in the middle of a scan.
    """
    gc.freeze()


def return_freed_memory() -> bool:
    """Have the C library hand back what is freed: for a process that is to stay small.

    Returns
    -------
    bool
        Whether it was done.
    """
    return _set(_KEPT_WHEN_SMALL, _FROM_SYSTEM_WHEN_SMALL)


def _set(kept: int, from_system: int) -> bool:
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):
        return False
    wanted = (_TRIM_THRESHOLD, kept), (_MMAP_THRESHOLD, from_system), (_ARENA_MAX, _ARENAS)
    return all([bool(mallopt(name, value)) for name, value in wanted])
