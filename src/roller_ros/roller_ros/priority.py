"""Letting other nodes of the graph go first on busy cores."""

from __future__ import annotations

import os
import time
from pathlib import Path

_GROUP = Path("/proc/self/autogroup")
#: Linux takes one such wish in a tenth of a second of those without rights, of all processes.
_ATTEMPTS, _AGAIN_S = 20, 0.1


def give_way(nice: int) -> None:
    """Lower the priority of this process; call it before it has threads.

    A process that leads a session, as each node of `roller up`, shares cores as a group of its own
    where the kernel groups by session (autogroup): there a process's niceness counts within its
    group only, and it's the group that has to give way.

    Parameters
    ----------
    nice : int
        By so much, 1 to 19.
    """
    os.nice(nice)
    if os.getsid(0) != os.getpid():
        return  # others are in its group
    for _ in range(_ATTEMPTS):
        try:
            _GROUP.write_text(str(nice))
        except BlockingIOError:
            time.sleep(_AGAIN_S)
        except OSError:
            return  # no such groups here, or none that we may change
        else:
            return
