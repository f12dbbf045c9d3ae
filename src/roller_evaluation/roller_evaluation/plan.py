"""Which passes the paper's experiments take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from roller_sim.objects import OBJECTS

from .paper_values import LARGE_UM
from .repeated_passes import Pass

#: Speed of all experiments but those on speed, m/s.
SPEED = 0.3
FAST = 0.5
#: Objects that the paper's weights were found and compared on.
CALIBRATION_SET = ("stairs", "sphere", "sparse_sphere")
FUSIONS = ("emvs", "left_right", "bma", "focus", "surface")
OURS = ("bma", "focus", "surface")
CONTACTS = ("light", "medium", "full")
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
    "time": "Processing time",
    "braille": "Braille by speed",
}


@dataclass(frozen=True)
class EvaluationOptions:
    """Size of an evaluation.

    Attributes
    ----------
    only : tuple of str
        Experiments to run, of `EXPERIMENTS`.
    repeats : int
        Passes of each kind, each with a seed of its own.
    seed : int
        Seed of the first.
    objects : tuple of str
        The single objects.
    speeds : tuple of float
        Of the experiment on speed, m/s.
    large : tuple of str
        The large plates.
    cell : mapping
        Settings of the virtual cell that differ from its defaults.
    quick : bool
        Whether this is the short form.
    """

    only: tuple[str, ...] = tuple(EXPERIMENTS)
    repeats: int = 5
    seed: int = 1
    objects: tuple[str, ...] = tuple(OBJECTS)
    speeds: tuple[float, ...] = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
    large: tuple[str, ...] = tuple(LARGE_UM)
    cell: Mapping[str, Any] = field(default_factory=dict)
    quick: bool = False

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
    def calibration_set(self) -> tuple[str, ...]:
        """Of the paper's three objects those that are looked at."""
        return tuple(name for name in CALIBRATION_SET if name in self.objects)


def passes(options: EvaluationOptions) -> dict[Pass, tuple[str, ...]]:
    """Passes that the experiments take, and the methods that each is measured with."""
    wanted: dict[Pass, dict[str, None]] = {}

    def add(asked: Pass, *methods: str) -> None:
        wanted.setdefault(asked, {}).update(dict.fromkeys(methods))

    o = options
    for seed in o.seeds:
        if "weights" in o.only:
            for name in o.calibration_set:
                add(Pass(name, SPEED, seed), "weights", "focus", "surface")
        if "fusion" in o.only:
            for name in o.calibration_set:
                add(Pass(name, SPEED, seed), *FUSIONS)
        if "objects" in o.only:
            for name in o.objects:
                add(Pass(name, SPEED, seed), *OURS)
        if "speed" in o.only:
            for speed in o.speeds:
                add(Pass("sphere", speed, seed), *FUSIONS)
        if "views" in o.only:
            add(Pass("sphere", SPEED, seed), "bma", "bma_5", "focus", "surface")
        if "lines" in o.only:
            add(Pass("three_lines", SPEED, seed, whole=True), *FUSIONS)
        if "force" in o.only:
            for contact in CONTACTS:
                add(Pass("bumps", SPEED, seed, contact), *OURS)
        if "large" in o.only:
            for plate in o.large:
                add(Pass(plate, SPEED, seed, whole=True), *OURS)
        if "sensors" in o.only:
            for name in o.objects:
                add(Pass(name, FAST, seed), *OURS)
    return {asked: tuple(methods) for asked, methods in wanted.items()}
