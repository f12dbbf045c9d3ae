"""What a benchmark measures: a base configuration a method, one factor varied at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from roller_sim.objects import OBJECTS
from roller_sim.presets import COATINGS

from .cases import Case, ScanCase

#: Objects of a full run.
ALL_OBJECTS = tuple(OBJECTS)
#: Objects with so many events that a window of the fixed case is drawn from real ones.
DENSE_OBJECTS = ("bumps", "hexagon")


@dataclass(frozen=True)
class BenchOptions:
    """Size of a run."""

    #: Two objects, one repeat, the variations that matter most.
    quick: bool = False
    #: How often each case is timed, at most; see `case_budget_s`.
    repeats: int = 3
    #: What is measured.
    objects: tuple[str, ...] = ALL_OBJECTS
    methods: tuple[str, ...] = ("focus", "bma", "left_right", "emvs", "surface")
    #: m/s; the first is the speed of all variations.
    speeds: tuple[float, ...] = (0.3, 0.5)
    #: A case of one object whose windows have taken longer than this isn't repeated again.
    case_budget_s: float = 1.0
    #: The fixed case: events and length of a window, speed of the scan, number of windows an
    #: object, and how many of them the dense reference works through.
    fixed_events: int = 100_000
    fixed_window_s: float = 0.02
    fixed_speed: float = 0.5
    fixed_windows: int = 15
    reference_windows: int = 5
    #: Steps by which the work grows.
    scaling_events: tuple[int, ...] = (10_000, 30_000, 100_000, 300_000, 1_000_000)
    scaling_planes: tuple[int, ...] = (50, 100, 250, 500)
    scaling_threads: tuple[int, ...] = (1, 2)
    #: Settings of the virtual cell that differ from its defaults.
    cell: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def short(cls, **changes: Any) -> BenchOptions:
        """The options of a quick run, with changes."""
        quick: dict[str, Any] = {
            "quick": True,
            "repeats": 1,
            "objects": ("stairs", "hexagon"),
            "methods": ("focus", "bma", "surface"),
            "speeds": (0.3,),
            "fixed_windows": 6,
            "reference_windows": 1,
            "scaling_events": (10_000, 100_000),
            "scaling_planes": (100, 500),
        }
        return cls(**{**quick, **changes})

    @property
    def dense(self) -> list[str]:
        """Objects of the fixed case and of the scaling."""
        found = [name for name in DENSE_OBJECTS if name in self.objects]
        return found or [self.objects[0]]

    def scan(self, name: str, speed: float, coating: str = "plain") -> ScanCase:
        """A scan of one object, under one of `COATINGS`."""
        return ScanCase(name, speed, cell=self.cell).changed(**COATINGS[coating])


#: Values of a factor: name and the settings that it changes.
Values = list[tuple[str, dict[str, Any]]]


def _densities(name: str) -> Values:
    """Planes per pixel of parallax, by the setting that a method has for it."""
    return [(f"{d:g} planes a px", {name: d}) for d in (2.0, 0.25)]


def _time(ms: int) -> tuple[str, dict[str, Any]]:
    return f"{ms} ms", {"window.rule": "time", "window.time_s": ms * 1e-3}


def _travel(mm: int) -> tuple[str, dict[str, Any]]:
    return f"{mm} mm", {"window.rule": "travel", "window.travel_m": mm * 1e-3}


#: Factors of a method, with their values. The others go through the same code as `bma`, with
#: fewer views, and are measured as they are and at every speed.
FACTORS: dict[str, dict[str, Values]] = {
    "focus": {
        "planes": _densities("focus.planes_per_px"),
        "window": [
            _travel(6),
            _travel(12),
            _time(20),
        ],
    },
    "bma": {
        "planes": [
            ("500 planes", {"paper.plane_rule": "fixed", "paper.planes": 500}),
            ("100 planes", {"paper.plane_rule": "fixed", "paper.planes": 100}),
        ],
        "window": [_time(10), _travel(12)],
        "packet": [("packets of 1024", {"packet_events": 1024})],
    },
    "surface": {
        "planes": _densities("evidence.planes_per_px"),
    },
}
#: Factors of which a quick run takes the first value.
_QUICK_FACTORS = ("planes", "window")
#: Methods that are measured on a printed coating too: by other ways than on a plain one, on many
#: times the events.
_ON_PRINT = ("focus", "surface")
_THREADS = 2


def depth_cases(options: BenchOptions) -> list[Case]:
    """All cases of a run over its objects, each of them once."""
    o = options
    cases: list[Case] = []

    def add(method: str, factor: str, value: str, speed: float, changes: dict[str, Any]) -> None:
        label = method if factor in ("base", "speed") else f"{method}, {value}"
        labels = {"label": label, "factor": factor, "value": value}
        cases.extend(
            Case(o.scan(name, speed), "depth", method, {"threads": _THREADS, **changes}, labels)
            for name in o.objects
        )

    for method in o.methods:
        add(method, "base", "base", o.speeds[0], {})
    for method in o.methods:
        for speed in o.speeds[1:]:
            add(method, "speed", f"{speed:g} m/s", speed, {})
        for factor, values in FACTORS.get(method, {}).items():
            if not o.quick or factor in _QUICK_FACTORS:
                for value, changes in values[:1] if o.quick else values:
                    add(method, factor, value, o.speeds[0], changes)
    for method in (m for m in o.methods if m in _ON_PRINT):
        labels = {"label": f"{method}, printed", "factor": "coating", "value": "printed"}
        for name in o.objects:
            scan = o.scan(name, o.speeds[0], "textured")
            cases.append(Case(scan, "pass", method, {"threads": _THREADS}, labels))
    return cases


def fixed_cases(options: BenchOptions) -> list[Case]:
    """The fixed case, one a dense object."""
    o = options
    settings = {"window_s": o.fixed_window_s, "events": o.fixed_events,
                "windows": o.fixed_windows, "reference": o.reference_windows}  # fmt: skip
    return [Case(o.scan(n, o.fixed_speed), "fixed_window", "all", settings) for n in o.dense]
