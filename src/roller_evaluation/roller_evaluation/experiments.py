"""The paper's experiments: which scans they take, and what is measured on them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from roller_sim.objects import OBJECTS
from roller_sim.presets import LIGHTS

from .cases import Case, ScanCase
from .paper_values import LARGE_UM

#: Speed of all experiments but those on speed, m/s.
SPEED = 0.3
FAST = 0.5
#: Objects that the paper's weights were found and compared on.
CALIBRATION_SET = ("stairs", "sphere", "sparse_sphere")
FUSIONS = ("emvs", "left_right", "bma", "focus", "surface")
OURS = ("bma", "focus", "surface")
CONTACTS = ("light", "medium", "full")
#: Threads of the methods that are timed.
THREADS = 2
#: Experiments by name, in the order of the report.
EXPERIMENTS = {
    "weights": "Weights of the views, found on one object and tried on all",
    "fusion": "Depth methods on the calibration set",
    "objects": "The six objects",
    "speed": "Error against speed, on the sphere",
    "views": "Three and five reference views",
    "lines": "Spread of depth over three equal lines",
    "force": "Contact force",
    "large": "Large surfaces",
    "sensors": "Sensors that roll",
    "map": "Height maps on the plain coating",
    "time": "Processing time",
    "braille": "Braille by speed",
}


@dataclass(frozen=True)
class EvaluationOptions:
    """Size of an evaluation."""

    #: Experiments to run, of `EXPERIMENTS`.
    only: tuple[str, ...] = tuple(EXPERIMENTS)
    #: Passes of each kind, each with a seed of its own.
    repeats: int = 5
    #: Seed of the first.
    seed: int = 1
    #: The single objects.
    objects: tuple[str, ...] = tuple(OBJECTS)
    #: Of the experiment on speed, m/s.
    speeds: tuple[float, ...] = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
    #: The large plates.
    large: tuple[str, ...] = tuple(LARGE_UM)
    #: Of the virtual cell's `LIGHTS`; the objects are rolled over once in each but the ring, which
    #: is that of all other experiments.
    lights: tuple[str, ...] = tuple(LIGHTS)
    #: Settings of the virtual cell that differ from its defaults.
    cell: Mapping[str, Any] = field(default_factory=dict)
    #: Settings of depth methods that were calibrated, by light, then by method: they hold there.
    calibrated: Mapping[str, Mapping[str, Mapping[str, Any]]] = field(default_factory=dict)
    #: Whether this is the short form.
    quick: bool = False
    #: Light and sensor that Braille is read in, of `braille.CONDITIONS`; all if empty.
    conditions: tuple[str, ...] = ()
    #: Draw depth maps and clouds of the objects.
    pictures: bool = True

    @classmethod
    def short(cls, **changes: Any) -> EvaluationOptions:
        """One pass of each kind, over two objects at two speeds."""
        small = cls(
            repeats=1,
            objects=("stairs", "sphere"),
            speeds=(0.3, 0.5),
            large=("line_array",),
            cell={"scene": {"step_mm": 0.04}},
            quick=True,
        )
        return replace(small, **changes)

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of the passes."""
        return tuple(range(self.seed, self.seed + self.repeats))

    @property
    def map_seeds(self) -> tuple[int, ...]:
        """Of height maps twice as many: from scan to scan a linear one changes by micrometres."""
        return tuple(range(self.seed, self.seed + 2 * self.repeats))

    @property
    def calibration_set(self) -> tuple[str, ...]:
        """Of the paper's three objects those that are looked at."""
        return tuple(name for name in CALIBRATION_SET if name in self.objects)


def object_speeds(options: EvaluationOptions) -> list[float]:
    """Speeds at which the objects are rolled over, m/s."""
    return [v for name, v in (("objects", SPEED), ("sensors", FAST)) if name in options.only]


def experiment_cases(options: EvaluationOptions) -> list[Case]:
    """What the experiments measure, pass by pass; what several of them take is there once."""
    o = options
    cases: dict[str, Case] = {}

    def add(
        scan: ScanCase, measure: str, *methods: str, contact: str = "full", light: str = "ring"
    ) -> None:
        pressed = scan.changed(**LIGHTS[light]).changed(skin={"contact": contact})
        for method in methods:
            settings = o.calibrated.get(light, {}).get(method, {})
            case = Case(pressed, measure, method, settings, {"contact": contact, "light": light})
            cases.setdefault(case.key, case)

    for speed in object_speeds(o):
        for light in o.lights:
            for seed in o.seeds if light == "ring" else o.seeds[:1]:
                for name in o.objects:
                    add(ScanCase(name, speed, seed, o.cell), "depth", *OURS, light=light)
    if "map" in o.only:
        for light, name, seed in itertools.product(o.lights, o.objects, o.map_seeds):
            add(ScanCase(name, SPEED, seed, o.cell), "map", "surface", light=light)
    for seed in o.seeds:

        def scan(name: str, speed: float = SPEED, seed: int = seed) -> ScanCase:
            return ScanCase(name, speed, seed, o.cell)

        if "weights" in o.only:
            for name in o.calibration_set:
                add(scan(name), "weights", "bma")
                add(scan(name), "depth", "focus", "surface")
        if "fusion" in o.only:
            for name in o.calibration_set:
                add(scan(name), "depth", *FUSIONS)
        if "speed" in o.only:
            for speed in o.speeds:
                add(scan("sphere", speed), "depth", *FUSIONS)
        if "views" in o.only:
            add(scan("sphere"), "depth", "bma", "bma_5", "focus", "surface")
        if "lines" in o.only:
            add(scan("three_lines"), "plate", *FUSIONS)
        if "force" in o.only:
            for contact in CONTACTS:
                add(scan("bumps"), "depth", *OURS, contact=contact)
        if "large" in o.only:
            for plate in o.large:
                add(scan(plate), "plate", *OURS)
    return list(cases.values())


def timed_cases(options: EvaluationOptions) -> list[Case]:
    """Cases of the experiment on processing time."""
    labels = {"factor": "base", "value": "base"}
    return [
        Case(
            ScanCase(name, speed, options.seed, options.cell), "depth", method,
            {"threads": THREADS, **options.calibrated.get("ring", {}).get(method, {})},
            {"label": method, **labels},
        )
        for speed in (SPEED, FAST)
        for name in options.objects
        for method in FUSIONS
    ]  # fmt: skip
