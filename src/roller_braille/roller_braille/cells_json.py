"""What the reader found, as plain data for files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from .cells import Cell
from .translation import LineCell, line_reader


def cells_to_json(
    cells: Iterable[Cell], lines: Sequence[Sequence[LineCell]], code: str
) -> dict[str, Any]:
    """Cells and text as data that `json.dump` takes.

    Parameters
    ----------
    cells : iterable of Cell
        In any order; they are written in reading order.
    lines : sequence of sequences of LineCell
        `BraillePipeline.lines()`.
    code : str
        The setting `code`.

    Returns
    -------
    dict
        `code`; `text`: the lines; `lines`: of each its text, its cells as Unicode patterns, and for
        each character the column of the cell it comes from; `cells`: one entry a cell, times in
        seconds and lengths in metres.
    """
    read = line_reader(code)
    found = [(line, read(line)) for line in lines]
    return {
        "code": code,
        "text": [reading.text.rstrip(" ") for _, reading in found],
        "lines": [
            {
                "text": reading.text,
                "cells": "".join(cell.shown for cell in line),
                "cell_of_character": list(reading.cells),
            }
            for line, reading in found
        ],
        "cells": [
            {
                "stamp_s": cell.stamp_ns * 1e-9,
                "line": cell.line,
                "column": cell.column,
                "mask": cell.mask,
                "pattern": cell.pattern,
                "character": cell.character,
                "readable": cell.readable,
                "position_m": [float(v) for v in cell.position],
                "confidence": cell.confidence,
                "dot_confidence": list(cell.dot_confidence),
            }
            for cell in sorted(cells, key=lambda cell: (cell.line, cell.column))
        ],
    }
