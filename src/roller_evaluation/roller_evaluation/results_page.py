"""`docs/results.md`: what a run measured, with the machine, the date and the command line."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from roller_core.errors import UnwritableOutputError
from roller_core.marked_file import write_marked_file

from .bench import PAPER, fronts, summarise
from .bench_plots import draw_speed_vs_error
from .experiments import SPEED, EvaluationOptions, object_speeds
from .paper_tables import by_light, height_maps, objects
from .rows import Row, where
from .tables import Table, markdown_page, share
from .time_table import processing_time

#: How every such page begins: no other file is ever replaced.
MARK = "<!-- roller evaluate -->"
#: Line that ends what a run writes; what people write below it stays.
END = "<!-- roller evaluate: end; what follows is written by hand and kept -->"
_PICTURE = "speed_vs_error.png"


def write_results(
    result: dict[str, Any], options: EvaluationOptions, words: Sequence[str], path: Path
) -> None:
    """Write the page, and its picture `speed_vs_error.png` beside it.

    What stands below the line `END` in a page that is replaced is kept, byte for byte.

    Parameters
    ----------
    result : dict
        Of `run_evaluation`; what it didn't measure is left out.
    options : EvaluationOptions
        Of the run.
    words : sequence of str
        The command line.
    path : path
        Markdown file.

    Raises
    ------
    UnwritableOutputError
        If it can't be written, or if a file of others stands there.
    """
    check_results(path)
    drawn: dict[str, Any] | None = None
    found = [by_light(result["rows"], options)] if object_speeds(options) else []
    found += [objects(result["rows"], options, speed) for speed in object_speeds(options)]
    if "map" in options.only:
        found.append(height_maps(result["rows"], options))
    picture = ""
    if "time" in result:
        cases = summarise(result["time"])
        drawn = {"cases": cases, "pareto": fronts(cases, SPEED), "paper": PAPER}
        drawn["options"] = {"speeds": [SPEED], "objects": options.objects}
        picture = f"\n\n![error against time, with the Pareto front]({_PICTURE})"
        found.append(processing_time(result["time"]))
    if "braille" in result:
        found.append(_braille(result["braille"]["rows"]))
    facts = result["facts"]
    kinds = f"{facts['passes of each kind']} passes of each kind" if options.repeats > 1 else (
        "one pass of each kind"
    )  # fmt: skip
    versions = [k for k in facts if k not in ("processor", "cores", "system", "date", "form")][2:]
    about = (
        "Measured on the virtual cell, whose depths are known; the paper's figures are of a real "
        "sensor. Compare methods within a table, and orders of magnitude with the paper.\n\n"
        f"{facts['date']}, {facts['processor']}, {facts['cores']} cores, {facts['system']}; "
        + ", ".join(f"{name} {facts[name]}" for name in versions)
        + f"; {kinds}. Written by\n\n```\n{shlex.join(words)}\n```{picture}"
    )
    page = f"{MARK}\n{markdown_page('Results', about, found)}\n{END}\n"
    write_marked_file(path, page, MARK, end=END)
    if drawn is not None:
        draw_speed_vs_error(drawn, path.with_name(_PICTURE))


def check_results(path: Path) -> None:
    """Refuse a page, or a picture beside it, that roller didn't write.

    Raises
    ------
    UnwritableOutputError
        If there is one.
    """
    ours = path.is_file() and path.read_bytes().startswith(MARK.encode())
    for file in (path, path.with_name(_PICTURE)):
        if os.path.lexists(file) and not ours:
            raise UnwritableOutputError(f"{file}: roller did not write it; give another --results")


def _braille(rows: Sequence[Row]) -> Table:
    """Character error rates by condition and speed."""
    auto = where(rows, method="auto")
    speeds = sorted({r["speed"] for r in auto})
    cells = []
    for condition in dict.fromkeys(r["condition"] for r in auto):
        own = {r["speed"]: r for r in where(auto, condition=condition)}
        rates = [own[v]["character_error_rate"] if v in own else None for v in speeds]
        cells.append((condition, *map(share, rates)))
    note = (
        "Character error rate (changed, missed and extra characters by true ones) with the "
        "default settings; – was not tried."
    )
    return Table("Braille by speed", ("condition", *(f"{v:g} m/s" for v in speeds)), cells, note)
