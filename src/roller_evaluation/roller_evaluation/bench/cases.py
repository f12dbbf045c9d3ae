"""The cases of a benchmark: a base configuration for each method, one factor varied at a time."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.surface import SurfaceSettings

from .options import BenchOptions

#: Methods whose every factor is varied. The others go through the same code as `bma`, with fewer
#: views, and are measured as they are and at every speed.
VARIED = ("focus", "bma", "surface")

_FIXED = {"paper.plane_rule": "fixed"}
_ALL_OFF = {**_FIXED, "paper.planes": 500}
#: Values of a factor: name and the settings that it changes.
Values = list[tuple[str, dict[str, Any]]]

_COUNTS: Values = [
    # 500 are measured without the savings, and as one of them.
    ("100 planes", {**_FIXED, "paper.planes": 100}),
]


def _densities(name: str, *densities: float) -> Values:
    """Planes per pixel of parallax, by the setting that a method has for it."""
    return [(f"{d:g} planes a px", {name: d}) for d in densities]


_PACKETS: Values = [
    ("packets of 64", {"packet_events": 64}),
    ("packets of 1024", {"packet_events": 1024}),
]
_NO_DRIFT = "no edge drift correction"


def _travel(mm: int) -> tuple[str, dict[str, Any]]:
    return f"{mm} mm", {"window.rule": "travel", "window.travel_m": mm * 1e-3}


_FACTORS: dict[str, dict[str, Values]] = {
    "focus": {
        "planes": _densities("focus.planes_per_px", 2.0, 0.25),
        "window": [
            _travel(6),
            _travel(12),
            ("20 ms", {"window.rule": "time", "window.time_s": 0.02}),
        ],
        "packet": _PACKETS,
        "edge_drift": [(_NO_DRIFT, {"focus.edge_drift_m": 0.0})],
    },
    "bma": {
        "savings": [("500 planes", _ALL_OFF)],
        "planes": _COUNTS,
        "window": [("10 ms", {"window.rule": "time", "window.time_s": 0.01}), _travel(12)],
        "packet": _PACKETS,
    },
    "surface": {
        "planes": _densities("evidence.planes_per_px", 2.0, 0.25),
        "edge_drift": [(_NO_DRIFT, {"evidence.edge_drift_m": 0.0})],
    },
}
#: Factors of a quick run, and how many values of each.
_QUICK_FACTORS = {"savings": 1, "planes": 1, "window": 1, "edge_drift": 1}

_ALL = ("focus", "bma", "surface")
#: Savings of the depth engine: title, settings with it, settings without it, methods that have it.
SAVINGS: tuple[tuple[str, dict[str, Any], dict[str, Any], tuple[str, ...]], ...] = (
    # `focus` always takes as many planes as the parallax asks for, and votes in one view.
    ("plane count from parallax", {}, {**_FIXED, "paper.planes": 500}, ("bma",)),
    ("patch of ±12 mm", {"patch_half_length_m": 0.012}, {"patch_half_length_m": 0.0}, _ALL),
)
#: What is to be said beside them.
SAVINGS_NOTE = (
    "The virtual cell's contact reaches 13 mm to either side of the axis, as far as the image: a "
    "patch of ±12 mm leaves out some of it, and with the events their parallax. It saves where the "
    "contact is shorter than the image."
)


@dataclass(frozen=True)
class Case:
    """One configuration.

    Attributes
    ----------
    method : str
        The method.
    factor, value : str
        What differs from the method's base configuration, and what it is; `base` for itself.
    speed : float
        Of the scan, m/s.
    changes : mapping
        Settings that differ from the defaults.
    """

    method: str
    factor: str
    value: str
    speed: float
    changes: Mapping[str, Any]

    @property
    def label(self) -> str:
        """Name for tables and figures."""
        return self.method if self.factor == "base" else f"{self.method}, {self.value}"

    @property
    def settings(self) -> DepthSettings | SurfaceSettings:
        """Settings in full."""
        if self.method == "surface":
            return SurfaceSettings.create(dict(self.changes), self.label)
        return depth_settings(self.method, **self.changes)

    @property
    def key(self) -> str:
        """The same for cases that come to the same work."""
        values = json.dumps(self.settings.model_dump(), sort_keys=True, default=str)
        return f"{self.method} {self.speed:g} {values}"


def depth_settings(method: str, **changes: Any) -> DepthSettings:
    """Settings of a method that makes depth maps."""
    return DepthSettings.create({"method": method, **changes}, method)


def plan(options: BenchOptions) -> list[Case]:
    """All cases of a run, each of them once.

    Parameters
    ----------
    options : BenchOptions
        Methods and speeds; the first speed is that of the base configurations.
    """
    base_speed = options.speeds[0]
    cases = [Case(m, "base", "base", base_speed, {}) for m in options.methods]
    for method in options.methods:
        for speed in options.speeds[1:]:
            cases.append(Case(method, "speed", f"{speed:g} m/s", speed, {}))
        if method in VARIED:
            cases += _variations(method, base_speed, options.quick)
    return _distinct(cases)


def _variations(method: str, speed: float, quick: bool) -> list[Case]:
    out = []
    for factor, values in _FACTORS[method].items():
        kept = values[: _QUICK_FACTORS.get(factor, 0)] if quick else values
        out += [Case(method, factor, value, speed, changes) for value, changes in kept]
    return out


def _distinct(cases: Iterable[Case]) -> list[Case]:
    """Without the values that are the base configuration's own."""
    found: dict[str, Case] = {}
    for case in cases:
        found.setdefault(case.key, case)
    return list(found.values())
