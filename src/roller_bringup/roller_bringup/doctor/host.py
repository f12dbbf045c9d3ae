"""Settings of the machine at the robot: what makes poses and packets late."""

from __future__ import annotations

import resource
from dataclasses import dataclass
from pathlib import Path

from .result import Result, ok, warning

#: Bytes that a socket should hold: a packet of events has up to 380 kB, and 20 wait while a
#: reader is busy.
_GOOD_BUFFER = 8 << 20


@dataclass(frozen=True)
class HostSettings:
    """What the system is set to."""

    #: Of the processor's frequency; empty: the machine shows none (a virtual one).
    governor: str
    #: Most that a socket may hold (net.core.rmem_max); 0: not known.
    socket_bytes: int
    #: Whether the kernel is preemptible throughout (PREEMPT_RT).
    realtime_kernel: bool
    #: Highest real-time priority that a process of this user may take; 0: none.
    priority: int


def find_host(root: Path = Path("/")) -> HostSettings:
    """Look at the system's files."""

    def read(path: str) -> str:
        try:
            return (root / path).read_text().strip()
        except OSError:
            return ""

    buffer = read("proc/sys/net/core/rmem_max")
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[1]
    return HostSettings(
        read("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
        int(buffer) if buffer.isdigit() else 0,
        read("sys/kernel/realtime") == "1",
        99 if limit == resource.RLIM_INFINITY else limit,
    )


def judge_host(found: HostSettings) -> Result:
    """Whether poses and packets come in time here.

    A kernel for real time isn't needed: poses carry the controller's own time, and the map between
    the clocks leaves out what came late. It helps where this machine also steers the robot.
    """
    kernel = "real-time kernel" if found.realtime_kernel else "ordinary kernel"
    text = (
        f"{kernel}, real-time priority up to {found.priority}, socket buffers up to "
        f"{found.socket_bytes / 1e6:.1f} MB, frequency {found.governor or 'not shown'}"
    )
    advice = []
    if found.governor == "powersave":
        advice.append("cpupower frequency-set -g performance")
    if 0 < found.socket_bytes < _GOOD_BUFFER:
        advice.append(f"sysctl -w net.core.rmem_max={_GOOD_BUFFER} where the graph spans machines")
    return warning("host", text, "; ".join(advice)) if advice else ok("host", text)
