"""Processor, memory, and the disk that recordings go to: room and speed."""

from __future__ import annotations

import os
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


@dataclass(frozen=True)
class MachineFacts:
    """Cores that this process may use, and bytes of memory that are free; 0: not known."""

    cores: int
    memory_bytes: float


def find_machine(meminfo: str = "/proc/meminfo") -> MachineFacts:
    """Count them."""
    memory = 0.0
    try:
        for line in Path(meminfo).read_text().splitlines():
            if line.startswith("MemAvailable:"):
                memory = float(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        memory = 0.0
    return MachineFacts(len(os.sched_getaffinity(0)), memory)


def judge_machine(facts: MachineFacts) -> Result:
    """Whether the graph keeps up."""
    found = f"{facts.cores} cores, {facts.memory_bytes / 1e9:.1f} GB of memory free"
    name = "machine"
    if 0 < facts.memory_bytes < _LEAST_MEMORY:
        return fault(name, found, "close other programs: 2 GB are needed")
    if facts.cores < _GOOD_CORES:
        advice = "two cores keep up with about 0.1 m/s; at more, depth comes after the scan"
        return warning(name, found, advice)
    if 0 < facts.memory_bytes < _GOOD_MEMORY:
        advice = "close other programs: events that wait for poses and depth take memory"
        return warning(name, found, advice)
    return ok(name, found)


@dataclass(frozen=True)
class DiskFacts:
    """Where it is, free bytes, and bytes a second written; `fault`: why nothing could be."""

    path: str
    free_bytes: float = 0.0
    bytes_s: float = 0.0
    fault: str = ""


def find_disk(folder: Path, probe_bytes: int = _PROBE_BYTES) -> DiskFacts:
    """Write a file for a moment where recordings would go, and take it away again."""
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
        return DiskFacts(str(there), fault=error.strerror or str(error))
    return DiskFacts(str(there), free, written / max(time.perf_counter() - begin, 1e-9))


def judge_disk(facts: DiskFacts) -> Result:
    """Whether a busy scan (10 million events a second) can be recorded."""
    name = "disk"
    if facts.fault:
        return fault(
            name, f"{facts.path}: can't be written ({facts.fault})", "give another --output"
        )
    minutes = facts.free_bytes / _NEEDED_BYTES_S / 60
    found = (
        f"{facts.path}: {facts.free_bytes / 1e9:.0f} GB free, {facts.bytes_s / 1e6:.0f} MB/s; "
        f"10 Mev/s take {_NEEDED_BYTES_S / 1e6:.0f} MB/s, room for {minutes:.0f} min"
    )
    if facts.free_bytes < _LEAST_FREE:
        return fault(name, found, "make room, or give --output")
    if facts.bytes_s < _NEEDED_BYTES_S:
        return warning(name, found, "record to a faster disk (--output), or roll slower")
    if minutes < _LEAST_MINUTES:
        return warning(name, found, "make room")
    return ok(name, found)
