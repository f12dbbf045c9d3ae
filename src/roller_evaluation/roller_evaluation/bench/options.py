"""What a benchmark runs over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from roller_sim.objects import OBJECTS

#: Objects of a full run.
ALL_OBJECTS = tuple(OBJECTS)
#: Objects of a quick run: few events, relief of both kinds.
QUICK_OBJECTS = ("stairs", "hexagon")
#: Objects with so many events that a window of the fixed case is drawn from real ones.
DENSE_OBJECTS = ("bumps", "hexagon")


@dataclass(frozen=True)
class BenchOptions:
    """Size of a run.

    Attributes
    ----------
    quick : bool
        Two objects, one repeat, the variations that matter most.
    repeats : int
        How often each case is timed, at most; see `case_budget_s`.
    objects, methods : tuple of str
        What is measured.
    speeds : tuple of float
        m/s; the first is the speed of all variations.
    case_budget_s : float
        A case whose windows have taken longer than this isn't repeated again.
    fixed_events, fixed_window_s, fixed_speed, fixed_windows, reference_windows
        The fixed case: events and length of a window, speed of the scan, number of windows, and
        how many of them the dense reference works through.
    growth_events, growth_planes, growth_scales, growth_threads
        Steps by which the work grows; scales are of the image's sides.
    cell : mapping
        Settings of the virtual cell that differ from its defaults.
    slider : path, optional
        Folder of the public sequence slider_depth.
    """

    quick: bool = False
    repeats: int = 3
    objects: tuple[str, ...] = ALL_OBJECTS
    methods: tuple[str, ...] = ("focus", "bma", "left_right", "emvs", "surface")
    speeds: tuple[float, ...] = (0.3, 0.5)
    case_budget_s: float = 6.0
    fixed_events: int = 100_000
    fixed_window_s: float = 0.02
    fixed_speed: float = 0.5
    fixed_windows: int = 30
    reference_windows: int = 10
    growth_events: tuple[int, ...] = (10_000, 30_000, 100_000, 300_000, 1_000_000)
    growth_planes: tuple[int, ...] = (50, 100, 250, 500)
    growth_scales: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0)
    growth_threads: tuple[int, ...] = (1, 2)
    cell: Mapping[str, Any] = field(default_factory=dict)
    slider: Path | None = None

    @classmethod
    def short(cls, **changes: Any) -> BenchOptions:
        """The options of a quick run, with changes."""
        return cls(
            **{
                "quick": True,
                "repeats": 1,
                "objects": QUICK_OBJECTS,
                "methods": ("focus", "bma", "surface"),
                "speeds": (0.3,),
                "fixed_windows": 6,
                "reference_windows": 1,
                "growth_events": (10_000, 100_000),
                "growth_planes": (100, 500),
                "growth_scales": (0.5, 1.0),
                "growth_threads": (1, 2),
                **changes,
            }
        )
