"""All experiments of the paper: measured, beside its figures, as a page and as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from roller_core.progress import OnProgress, no_progress, part_of

from .braille import BrailleOptions, run_braille
from .braille_report import tables as braille_tables
from .cases import Case, ScanCase
from .experiments import (
    EXPERIMENTS,
    FUSIONS,
    OURS,
    SPEED,
    EvaluationOptions,
    experiment_cases,
    timed_cases,
)
from .measures import pictured
from .page import page
from .paper_plots import draw_object, draw_speed
from .paper_tables import by_light, tables
from .rows import provenance, write_rows
from .run import run, run_timed
from .scans import ScanStore
from .tables import Table, write_json
from .time_table import processing_time

#: What runs besides the passes, as a share of the whole.
_AFTER = 0.3
#: The paper's colours, and one in which equal steps look equal.
_COLOURS = ("jet", "cividis")


def run_evaluation(
    options: EvaluationOptions,
    output: Path,
    *,
    jobs: int = 1,
    on_progress: OnProgress = no_progress,
) -> dict[str, Any]:
    """Run experiments, and write `index.html`, `evaluation.json` and `rows.csv`.

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
    on_progress : callable
        Takes what is being done and the share done, 0–1.

    Returns
    -------
    dict
        What `evaluation.json` holds, and `tables` by experiment.

    Raises
    ------
    RollerError
        If a setting is no good.
    """
    part = partial(part_of, on_progress)
    o, only = options, options.only
    rows = run(experiment_cases(o), output / "passes", jobs=jobs, on_progress=part(0.0, 1 - _AFTER))
    found = tables(rows, o)
    result: dict[str, Any] = {"facts": _facts(o), "options": asdict(o), "rows": rows}
    shown: dict[str, list[Table]] = {name: [table] for name, table in found.items()}
    figures: dict[str, list[tuple[str, bytes]]] = {}
    if "objects" in only:
        shown["objects"].append(by_light(rows, o))
    if "speed" in only:
        figures["speed"] = [("Error and coverage by speed", draw_speed(rows, o))]
    if "objects" in only and o.pictures:
        on_progress("pictures", 1 - _AFTER)
        figures["objects"] = _pictures(o)
    if "time" in only:
        scans = ScanStore(hold=2 * len(o.objects), threads=0)
        repeats = 2 if o.quick else 5
        result["time"] = run_timed(
            timed_cases(o), scans, repeats, on_progress=part(1 - 0.8 * _AFTER, 1 - 0.5 * _AFTER)
        )
        shown["time"] = [processing_time(result["time"])]
    if "braille" in only:
        kind = BrailleOptions.short if o.quick else BrailleOptions
        braille = kind(seed=o.seed)
        if o.conditions:
            braille = replace(braille, conditions=o.conditions)
        result["braille"] = run_braille(
            braille, output, jobs=jobs, on_progress=part(1 - 0.5 * _AFTER, 1.0)
        )
        shown["braille"] = braille_tables(result["braille"])
        figures["braille"] = [("Braille by speed", (output / "braille.png").read_bytes())]
    sections = [
        (title, shown[name], figures.get(name, []))
        for name, title in EXPERIMENTS.items()
        if name in shown
    ]
    write_json(result, output / "evaluation.json")
    timed = result.get("time", [])
    write_rows([*rows, *timed, *result.get("braille", {}).get("rows", [])], output / "rows.csv")
    html = page(sections, result["facts"], _settings(o))
    (output / "index.html").write_text(html, encoding="utf-8")
    return {**result, "tables": {name: shown[name] for name in EXPERIMENTS if name in shown}}


def _pictures(o: EvaluationOptions) -> list[tuple[str, bytes]]:
    scans, out = ScanStore(threads=0), []
    for name in o.objects:
        scan_case = ScanCase(name, SPEED, o.seed, o.cell).changed(skin={"contact": "full"})
        scan = scans.get(scan_case)
        shown = {method: pictured(Case(scan_case, "depth", method), scan) for method in OURS}
        for colours in _COLOURS:
            out.append((f"{name}, depth maps and clouds, {colours}", draw_object(shown, colours)))
    return out


def _facts(o: EvaluationOptions) -> dict[str, Any]:
    return {
        "passes of each kind": o.repeats,
        "seeds": ", ".join(map(str, o.seeds)),
        **provenance(),
        "form": "quick: few passes, coarse scenes" if o.quick else "full",
    }


def _settings(o: EvaluationOptions) -> str:
    scan = ScanCase("sphere", SPEED)
    shown = {name: Case(scan, "depth", name).depth.model_dump(mode="json") for name in FUSIONS}
    return json.dumps({"cell, beside defaults": dict(o.cell), "methods": shown}, indent=1)
