"""All experiments of the paper: measured, beside its figures, as a page and as JSON."""

from __future__ import annotations

import json
import platform
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from roller_core.output_folder import make_folder
from roller_core.progress import Tell, tell_nobody

from .braille import BrailleOptions, run_braille
from .braille_report import tables as braille_tables
from .measured import measure
from .page import page
from .paper_plots import draw_object, draw_speed
from .paper_tables import tables
from .plan import EXPERIMENTS, FUSIONS, OURS, SPEED, EvaluationOptions, passes
from .repeated_passes import Pass, pictured, scan_of, settings_of
from .tables import Table, write_json, write_text
from .timing import time_table, window_times

#: What runs besides the passes, as a share of the whole.
_AFTER = 0.2
_LIBRARIES = ("numpy", "numba", "scipy", "opencv-contrib-python-headless")
#: The paper's colours, and one in which equal steps look equal.
_COLOURS = ("jet", "cividis")


def run_evaluation(
    options: EvaluationOptions, output: Path, jobs: int = 1, tell: Tell = tell_nobody
) -> dict[str, Table]:
    """Run experiments, and write `index.html` and `evaluation.json`.

    What was measured is kept in `passes` and taken again by a run with the same settings, so a
    run that was broken off goes on.

    Parameters
    ----------
    options : EvaluationOptions
        Which, and how many passes.
    output : path
        Folder for the results.
    jobs : int
        Processes.
    tell : callable
        Told what is being done and the share done, 0–1.

    Returns
    -------
    dict of Table
        Tables by experiment.

    Raises
    ------
    UnwritableOutputError
        If results can't be written.
    RollerError
        If a setting is no good.
    """
    make_folder(output / "passes")
    wanted = passes(options)

    def told(text: str, share: float) -> None:
        tell(text, (1 - _AFTER) * share)

    measured = measure(wanted, options.cell, output / "passes", jobs, told)
    found = tables(measured, options)
    result: dict[str, Any] = {"options": asdict(options), "passes": measured.as_json()}
    figures: dict[str, list[tuple[str, bytes]]] = {}
    if "speed" in options.only:
        figures["speed"] = [("Error and coverage by speed", draw_speed(measured, options))]
    if "objects" in options.only:
        tell("pictures", 1 - _AFTER)
        figures["objects"] = _pictures(options)
    if "time" in options.only:
        tell("times", 1 - 0.6 * _AFTER)
        name = options.objects[0]
        scan = scan_of(Pass(name, SPEED, options.seed), options.cell, threads=0)
        result["time"] = window_times(scan, 2 if options.quick else 5)
        found["time"] = time_table(result["time"], name)
    braille: list[Table] = []
    if "braille" in options.only:

        def told_braille(text: str, share: float) -> None:
            tell(text, 1 - 0.5 * _AFTER * (1 - share))

        kind = BrailleOptions.short if options.quick else BrailleOptions
        result["braille"] = run_braille(kind(seed=options.seed), output, told_braille, jobs)
        braille = braille_tables(result["braille"])
        found["braille"] = braille[0]
        figures["braille"] = [("Braille by speed", (output / "braille.png").read_bytes())]
    sections = [
        (title, braille if name == "braille" else [found[name]], figures.get(name, []))
        for name, title in EXPERIMENTS.items()
        if name in options.only
    ]
    facts = _facts(options)
    write_json({"facts": facts, **result}, output / "evaluation.json")
    write_text(output / "index.html", page(sections, facts, _settings(options)))
    return {name: found[name] for name in EXPERIMENTS if name in found}


def _pictures(options: EvaluationOptions) -> list[tuple[str, bytes]]:
    out = []
    for name in options.objects:
        scan = scan_of(Pass(name, SPEED, options.seed), options.cell, threads=0)
        shown = {method: pictured(scan, method) for method in OURS}
        for colours in _COLOURS:
            out.append((f"{name}, depth maps and clouds, {colours}", draw_object(shown, colours)))
    return out


def _facts(options: EvaluationOptions) -> dict[str, Any]:
    return {
        "passes of each kind": options.repeats,
        "seeds": ", ".join(map(str, options.seeds)),
        "machine": f"{platform.processor() or platform.machine()}, {platform.system()}",
        "Python": platform.python_version(),
        **{name: version(name) for name in _LIBRARIES},
        "form": "quick: few passes, coarse scenes" if options.quick else "full",
    }


def _settings(options: EvaluationOptions) -> str:
    shown = {name: settings_of(name).model_dump(mode="json") for name in FUSIONS}
    return json.dumps({"cell, beside defaults": dict(options.cell), "methods": shown}, indent=1)
