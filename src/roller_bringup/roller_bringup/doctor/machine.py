"""Processor and memory."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from .result import Result

_GOOD_CORES = 4
_LEAST_MEMORY, _GOOD_MEMORY = 2e9, 4e9


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
        return Result(
            name=name, level="fault", found=found, advice="close other programs: 2 GB are needed"
        )
    if facts.cores < _GOOD_CORES:
        return Result(
            name=name,
            level="warning",
            found=found,
            advice="two cores keep up with about 0.1 m/s; at more, depth comes after the scan",
        )
    if 0 < facts.memory_bytes < _GOOD_MEMORY:
        return Result(
            name=name,
            level="warning",
            found=found,
            advice="close other programs: events that wait for poses and depth take memory",
        )
    return Result(name=name, level="OK", found=found)
