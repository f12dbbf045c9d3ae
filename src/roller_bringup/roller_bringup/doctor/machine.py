"""The machine: processor, memory, system settings; the disk that recordings go to."""

from __future__ import annotations

import os
import resource
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from .result import Result, fault, ok, warning

_GOOD_CORES = 4
_LEAST_MEMORY, _GOOD_MEMORY = 2e9, 4e9
#: A busy scan of 10 million events a second, 3 bytes each in libcaer_cmp (1.2 to 2.7 measured).
_NEEDED_BYTES_S = 10e6 * 3.0
_LEAST_FREE = 1e9
_LEAST_MINUTES = 10.0
_PROBE_BYTES = 64 << 20
_PROBE_S = 3.0


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def free_memory(meminfo: str = "/proc/meminfo") -> float:
    """Bytes of memory that are free; 0: not known."""
    try:
        for line in Path(meminfo).read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return float(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    return 0.0


def check_machine(cores: int, memory_bytes: float) -> Result:
    """Whether the graph keeps up; 0 bytes: not known."""
    found = f"{cores} cores, {memory_bytes / 1e9:.1f} GB of memory free"
    name = "machine"
    if 0 < memory_bytes < _LEAST_MEMORY:
        return fault(name, found, "close other programs: 2 GB are needed")
    if cores < _GOOD_CORES:
        advice = "two cores keep up with about 0.1 m/s; at more, depth comes after the scan"
        return warning(name, found, advice)
    if 0 < memory_bytes < _GOOD_MEMORY:
        advice = "close other programs: events that wait for poses and depth take memory"
        return warning(name, found, advice)
    return ok(name, found)


def measure_disk(folder: Path, probe_bytes: int = _PROBE_BYTES) -> tuple[str, float, float, str]:
    """Write a file for a moment where recordings would go, and take it away again.

    Returns
    -------
    str, float, float, str
        Where that is, free bytes, bytes a second written, and why nothing could be written.
    """
    there = folder.absolute()
    while not there.exists() and there != there.parent:
        there = there.parent
    path = there / f".roller_doctor_{os.getpid()}"
    block, written = os.urandom(1 << 20), 0
    try:
        free = shutil.disk_usage(there).free
        begin = time.perf_counter()
        try:
            with open(path, "wb", buffering=0) as file:
                while written < min(probe_bytes, free // 2):
                    written += file.write(block)
                    if time.perf_counter() - begin > _PROBE_S:
                        break
                os.fsync(file.fileno())
        finally:
            path.unlink(missing_ok=True)
    except OSError as error:
        return str(there), 0.0, 0.0, error.strerror or str(error)
    return str(there), free, written / max(time.perf_counter() - begin, 1e-9), ""


def check_disk(path: str, free_bytes: float, bytes_s: float, error: str = "") -> Result:
    """Whether a busy scan (10 million events a second) can be recorded: of `measure_disk`."""
    name = "disk"
    if error:
        return fault(name, f"{path}: can't be written ({error})", "give another --output")
    minutes = free_bytes / _NEEDED_BYTES_S / 60
    found = (
        f"{path}: {free_bytes / 1e9:.0f} GB free, {bytes_s / 1e6:.0f} MB/s; "
        f"10 Mev/s take {_NEEDED_BYTES_S / 1e6:.0f} MB/s, room for {minutes:.0f} min"
    )
    if free_bytes < _LEAST_FREE:
        return fault(name, found, "make room, or give --output")
    if bytes_s < _NEEDED_BYTES_S:
        return warning(name, found, "record to a faster disk (--output), or roll slower")
    if minutes < _LEAST_MINUTES:
        return warning(name, found, "make room")
    return ok(name, found)


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
