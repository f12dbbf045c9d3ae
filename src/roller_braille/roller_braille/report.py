"""What the reader found, as plain data for files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from .cells import Cell


def cells_to_json(cells: Iterable[Cell], lines: Sequence[str]) -> dict[str, Any]:
    """Cells and text as data that `json.dump` takes.

    Parameters
    ----------
    cells : iterable of Cell
        In the order they were given.
    lines : sequence of str
        `BraillePipeline.text()`.

    Returns
    -------
    dict
        `text`: the lines; `cells`: one entry a cell, times in seconds and lengths in metres.
    """
    return {
        "text": list(lines),
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
            for cell in cells
        ],
    }
