"""How well Braille is read, by speed, light and sensor; with wrong speeds and depths."""

from __future__ import annotations

import string
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from roller_braille.reader_settings import POSE_SMOOTHING, BrailleSettings
from roller_core.progress import OnProgress, no_progress
from roller_sim.cell_settings import SensorSettings
from roller_sim.presets import COATINGS, LIGHTS

from .cases import Case, ScanCase
from .rows import where
from .run import run
from .tables import write_json

_SENSOR = SensorSettings.create({})
#: Dots give as many events as models of event sensors give at a threshold of 0.25, 27 to 30
#: million a second over two lines at 0.5 m/s.
_STRONG = LIGHTS["strong"]["light"]
_STRONG_THRESHOLD = 0.25
_NOISY = {"background_hz": 10 * _SENSOR.background_hz}
#: Light and sensor, as changes of the virtual cell's settings by group.
CONDITIONS: dict[str, dict[str, dict[str, Any]]] = {
    "default": {},
    # Events come at multiples of the threshold: twice the threshold is half the contrast. In the
    # default light dots change the log intensity too little for any event at half the contrast.
    "70 % contrast": {"sensor": {"threshold": round(_SENSOR.threshold / 0.7, 3)}},
    "half contrast": {"sensor": {"threshold": 2 * _SENSOR.threshold}},
    "10 × noise": {"sensor": _NOISY},
    "textured coating": COATINGS["textured"],
    "strong light": {"light": _STRONG, "sensor": {"threshold": _STRONG_THRESHOLD}},
    "strong light, half contrast": {
        "light": _STRONG,
        "sensor": {"threshold": 2 * _STRONG_THRESHOLD},
    },
    "strong light, 10 × noise": {
        "light": _STRONG,
        "sensor": {"threshold": _STRONG_THRESHOLD, **_NOISY},
    },
}
#: Ways of reading, as changes of the reader's settings.
METHODS: dict[str, dict[str, Any]] = {
    "auto": {},
    "all events": {"polarity": "both"},
}
#: With contrast maximisation and without.
REFINED: dict[bool, dict[str, Any]] = {True: {}, False: {"max_scale_error": 0.0}}
#: Published readers and what they say of themselves; their plates, sensors and speeds differ.
PUBLISHED: tuple[dict[str, Any], ...] = (
    {"name": "Potdar et al. (DIGIT)", "speed": 0.18, "accuracy": 0.875},
    {"name": "Xu et al. (spiking)", "speed": 0.1, "accuracy": 0.9533},
    {"name": "Evetac", "speed": None, "accuracy": 0.98},
    {"name": "Müller-Cleve et al. (LSTM)", "speed": 0.01, "accuracy": 0.97},
    {"name": "the paper", "speed": 0.5, "accuracy": 1.0, "ms": 19.26},
)


@dataclass(frozen=True)
class BrailleOptions:
    """Size of the experiment."""

    #: Lines of a plate: what fits the view.
    text: str = 2 * string.ascii_lowercase + "\nthe quick brown fox jumps over the lazy dog"
    #: m/s.
    speeds: tuple[float, ...] = (0.05, 0.1, 0.18, 0.3, 0.5)
    #: Of `CONDITIONS`.
    conditions: tuple[str, ...] = tuple(CONDITIONS)
    #: Those of `speeds` at which conditions but the first are tried; all if none is of them.
    hard_speeds: tuple[float, ...] = (0.05, 0.3, 0.5)
    #: Of `METHODS`.
    methods: tuple[str, ...] = tuple(METHODS)
    #: m/s; wrong speeds and depths are tried at the one of `speeds` next to it.
    fault_speed: float = 0.3
    #: Errors of the poses' speed, as a share.
    speed_errors: tuple[float, ...] = (-0.1, 0.1)
    #: Errors of the depth, mm.
    depth_errors_mm: tuple[float, ...] = (-1.0, 1.0)
    #: Seed of all chance.
    seed: int = 1
    #: Other settings of the virtual cell by group.
    cell: dict[str, Any] = field(default_factory=lambda: {"scene": {"step_mm": 0.03}})

    @classmethod
    def short(cls, **changes: Any) -> BrailleOptions:
        """A run of a minute or so: a few letters at one speed, seen by part of the camera."""
        small = cls(
            text="quick jazz",
            speeds=(0.3,),
            conditions=("default", "half contrast", "strong light, half contrast"),
            speed_errors=(-0.1,),
            depth_errors_mm=(1.0,),
            cell={"scene": {"step_mm": 0.04}, "camera": {"width": 600, "height": 200}},
        )
        return replace(small, **changes)


def run_braille(
    options: BrailleOptions, output: Path, *, jobs: int = 1, on_progress: OnProgress = no_progress
) -> dict[str, Any]:
    """Simulate plates, read them, and write `braille.json` and `braille.png`.

    Parameters, errors and what is kept are those of `run.run`; the result is `braille.json`.
    """
    from .braille_report import draw

    rows = run(braille_cases(options), output / "passes", jobs=jobs, on_progress=on_progress)
    result = {
        "version": 2,
        "options": asdict(options),
        "published": list(PUBLISHED),
        "rows": where(rows, fault=None),
        "faults": [row for row in rows if row["fault"] is not None],
    }
    write_json(result, output / "braille.json")
    draw(result, output / "braille.png")
    return result


def braille_cases(options: BrailleOptions) -> list[Case]:
    """Every condition, speed and method; at one speed also wrong speeds and depths."""
    o, cases = options, []
    first = o.conditions[0]
    hard = set(o.hard_speeds) & set(o.speeds) or set(o.speeds)
    at = min(o.speeds, key=lambda v: abs(v - o.fault_speed))
    for condition in o.conditions:
        for speed in o.speeds if condition == first else sorted(hard):
            scan = ScanCase("braille", speed, o.seed, o.cell, POSE_SMOOTHING)
            scan = scan.changed(**CONDITIONS[condition], scene={"text": o.text})
            for method in o.methods:
                labels = {"condition": condition, "fault": None}
                cases.append(Case(scan, "braille", method, {"reader": METHODS[method]}, labels))
            if (condition, speed) == (first, at):
                cases += _faults(scan, o)
    return cases


def _faults(scan: ScanCase, o: BrailleOptions) -> list[Case]:
    """Readings with a wrong speed or a wrong depth."""
    depth_m = BrailleSettings.create({}).depth_m
    wrong: list[tuple[str, dict[str, Any], float]] = [("none", {}, 1.0)]
    wrong += [(f"speed {error:+.0%}", {}, 1.0 + error) for error in o.speed_errors]
    wrong += [
        (f"depth {error:+g} mm", {"depth_m": depth_m + error * 1e-3}, 1.0)
        for error in o.depth_errors_mm
    ]
    return [
        Case(
            scan, "braille", "auto",
            {"reader": {**reader, **REFINED[refined]}, "speed_factor": factor},
            {"fault": name, "refined": refined},
        )
        for name, reader, factor in wrong
        for refined in REFINED
    ]  # fmt: skip
