"""How well Braille is read, by speed, light and sensor; with wrong speeds and depths."""

from __future__ import annotations

import json
import re
import string
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from roller_braille.reader_settings import BrailleSettings
from roller_core.output_folder import make_folder
from roller_core.progress import Tell, tell_nobody
from roller_sim.cell_settings import SensorSettings, VirtualCellSettings

from .alignment import Score, score
from .braille_scans import BrailleScan, Reading, dot_contrast, read, simulate
from .jobs import Job, do_jobs
from .tables import write_json

_SENSOR = SensorSettings.create({})
#: Less scattered light and a narrower lobe: dots give as many events as models of event sensors
#: give at a threshold of 0.25, 27 to 30 million a second over two lines at 0.5 m/s.
_STRONG = {"ambient": 0.3, "specular": 0.35, "lobe_slope": 0.3}
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
#: To be raised when the reader or its figures change: what an older form left is read anew.
_FORM = 2
#: The paper's frame, to which times are scaled.
FRAME_EVENTS = 20_000


@dataclass(frozen=True)
class BrailleOptions:
    """Size of the experiment.

    Attributes
    ----------
    text : str
        Lines of a plate: what fits the view.
    speeds : tuple of float
        m/s.
    conditions, methods : tuple of str
        Of `CONDITIONS` and `METHODS`.
    hard_speeds : tuple of float
        Those of `speeds` at which conditions but the first are tried; all if none is of them.
    fault_speed : float
        m/s; wrong speeds and depths are tried at the one of `speeds` next to it.
    speed_errors : tuple of float
        Errors of the poses' speed, as a share.
    depth_errors_mm : tuple of float
        Errors of the depth, mm.
    seed : int
        Seed of all chance.
    cell : dict
        Other settings of the virtual cell by group.
    """

    text: str = 2 * string.ascii_lowercase + "\nthe quick brown fox jumps over the lazy dog"
    speeds: tuple[float, ...] = (0.05, 0.1, 0.18, 0.3, 0.5)
    conditions: tuple[str, ...] = tuple(CONDITIONS)
    hard_speeds: tuple[float, ...] = (0.05, 0.3, 0.5)
    methods: tuple[str, ...] = tuple(METHODS)
    fault_speed: float = 0.3
    speed_errors: tuple[float, ...] = (-0.1, 0.1)
    depth_errors_mm: tuple[float, ...] = (-1.0, 1.0)
    seed: int = 1
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
    options: BrailleOptions, output: Path, tell: Tell = tell_nobody, jobs: int = 1
) -> dict[str, Any]:
    """Simulate plates, read them, and write `braille.json` and `braille.png`.

    What was read is kept in `passes`, so a run that was broken off goes on.

    Parameters
    ----------
    options : BrailleOptions
        Size of the experiment.
    output : path
        Folder for the results.
    tell : callable
        Told what is being done and the share done, 0–1.
    jobs : int
        Processes.

    Returns
    -------
    dict
        What `braille.json` holds.

    Raises
    ------
    UnwritableOutputError
        If results can't be written.
    RollerError
        If the text or a setting is no good.
    """
    from .braille_plot import draw

    make_folder(output / "passes")
    first = options.conditions[0]
    hard = set(options.hard_speeds) & set(options.speeds) or set(options.speeds)
    asked = [(c, v) for c in options.conditions for v in options.speeds if c == first or v in hard]
    at = min(options.speeds, key=lambda v: abs(v - options.fault_speed))
    threads = 0 if jobs == 1 else 1
    work = [_job(options, c, v, (c, v) == (first, at), threads) for c, v in asked]
    # The slowest takes longest, and begins first.
    found = do_jobs(
        [job for _, job in sorted(zip(asked, work, strict=True), key=lambda w: w[0][1])],
        output / "passes", jobs, tell,
    )  # fmt: skip
    result = {
        "version": 1,
        "options": asdict(options),
        "published": list(PUBLISHED),
        "rows": [row for job in work for row in found[job.name]["rows"]],
        "faults": [row for job in work for row in found[job.name]["faults"]],
    }
    write_json(result, output / "braille.json")
    draw(result, output / "braille.png")
    return result


def _job(
    options: BrailleOptions, condition: str, speed: float, with_faults: bool, threads: int
) -> Job:
    """Reading of one scan."""
    changes = CONDITIONS[condition]
    cell = {**options.cell, **{k: {**options.cell.get(k, {}), **v} for k, v in changes.items()}}
    asked = {
        "form": _FORM,
        "options": asdict(options) | {"speeds": [], "conditions": [], "hard_speeds": []},
        "cell": cell,
        "speed": speed,
        "faults": with_faults,
        "reader": BrailleSettings.create({}).model_dump(mode="json"),
    }
    name = "braille_" + re.sub(r"\W+", "_", f"{condition} {speed:g}")
    arguments = (options, condition, speed, with_faults, {**cell, "threads": threads})
    return Job(name, json.loads(json.dumps(asked)), read_plate, arguments)


def read_plate(
    options: BrailleOptions, condition: str, speed: float, with_faults: bool, cell: dict[str, Any]
) -> dict[str, Any]:
    """Figures of one scan by method, and with faults.

    Parameters
    ----------
    options : BrailleOptions
        Text, methods, faults.
    condition : str
        Of `CONDITIONS`.
    speed : float
        m/s.
    with_faults : bool
        Whether to try wrong speeds and depths.
    cell : dict
        Settings of the virtual cell.
    """
    scan = simulate(options.text, speed, cell, options.seed)
    light = {
        "threshold": VirtualCellSettings.create(cell).sensor.threshold,
        "dot_contrast": dot_contrast(cell, options.seed),
    }
    rows = [
        {
            "condition": condition,
            "speed": speed,
            "method": method,
            **light,
            **_figures(scan, read(scan, METHODS[method])),
        }
        for method in options.methods
    ]
    return {"rows": rows, "faults": _faults(scan, speed, options) if with_faults else []}


def _faults(scan: BrailleScan, speed: float, options: BrailleOptions) -> list[dict[str, Any]]:
    """Readings with a wrong speed or a wrong depth."""
    depth_m = BrailleSettings.create({}).depth_m
    wrong: list[tuple[str, dict[str, Any], float]] = [
        (f"speed {error:+.0%}", {}, 1.0 + error) for error in options.speed_errors
    ]
    wrong += [
        (f"depth {error:+g} mm", {"depth_m": depth_m + error * 1e-3}, 1.0)
        for error in options.depth_errors_mm
    ]
    return [
        {
            "fault": name,
            "refined": refined,
            "speed": speed,
            **_figures(scan, read(scan, {**settings, **REFINED[refined]}, factor)),
        }
        for name, settings, factor in [("none", {}, 1.0), *wrong]
        for refined in REFINED
    ]


def _figures(scan: BrailleScan, reading: Reading) -> dict[str, Any]:
    result: Score = score(reading.lines, scan.lines)
    ms = np.array(reading.milliseconds or [0.0])
    # Frames end after some travel too; the cost of the same work in frames of the paper's size.
    frames = max(reading.events / FRAME_EVENTS, 1e-9)
    return {
        **asdict(result),
        "misread": result.misread,
        "character_accuracy": result.character_accuracy,
        "character_error_rate": result.character_error_rate,
        "word_error_rate": result.word_error_rate,
        "frames": len(reading.milliseconds),
        "events": reading.events,
        "ms_mean": float(ms.mean()),
        "ms_p95": float(np.quantile(ms, 0.95)),
        "ms_20000_events": float(ms.sum() / frames),
        "text": reading.lines,
    }
