"""What the reader found, for files: plain data, and Braille Ready Format.

The latter is cells as ASCII, pages of 25 lines of 40 cells (North American Braille).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from .cells import Cell
from .translation import LineCell, TextLine, line_reader


def cells_to_json(
    cells: Iterable[Cell], lines: Sequence[Sequence[LineCell]], code: str
) -> dict[str, Any]:
    """Cells and text as data that `json.dump` takes.

    Parameters
    ----------
    cells : iterable of Cell
        In the order they came; of one that came again the last counts. They are written by line
        and column.
    lines : sequence of sequences of LineCell
        `BraillePipeline.lines()`; those without a number are counted.
    code : str
        The setting `code`.

    Returns
    -------
    dict
        `code`; `text`: the lines; `lines`: of each its number, which its cells have, its text, its
        cells as Unicode patterns, and for each character the column of the cell it comes from;
        `cells`: one entry a cell, times in seconds and lengths in metres.
    """
    read = line_reader(code)
    found = [(line, read(line)) for line in lines]
    numbers = [line.number if isinstance(line, TextLine) else k for k, line in enumerate(lines)]
    last = {(cell.line, cell.column): cell for cell in cells}
    return {
        "code": code,
        "text": [reading.text.rstrip(" ") for _, reading in found],
        "lines": [
            {
                "line": number,
                "text": reading.text,
                "cells": "".join(cell.shown for cell in line),
                "cell_of_character": list(reading.cells),
            }
            for number, (line, reading) in zip(numbers, found, strict=True)
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
            for _, cell in sorted(last.items())
        ],
    }


#: ASCII of the cells by mask, dot 1 being bit 0.
_ASCII = " A1B'K2L@CIF/MSP\"E3H9O6R^DJG>NTQ,*5<-U8V.%[$+X!&;:4\\0Z7(_?W]#Y)="
_LINE_CELLS, _PAGE_LINES = 40, 25


def to_brf(lines: Iterable[Sequence[int]]) -> str:
    """Lines of cells as a BRF file.

    Parameters
    ----------
    lines : iterable of sequences of int
        Masks; lines of more than 40 cells go on in the next, broken at a space where there is one.

    Returns
    -------
    str
        Lines end in CR LF, pages in a form feed.
    """
    rows: list[str] = []
    for line in lines:
        text = "".join(_ASCII[mask] for mask in line).rstrip(" ")
        while len(text) > _LINE_CELLS:
            cut = text.rfind(" ", 0, _LINE_CELLS + 1)
            cut = cut if cut > 0 else _LINE_CELLS
            rows.append(text[:cut].rstrip(" "))
            text = text[cut:].lstrip(" ")
        rows.append(text)
    pages = [rows[k : k + _PAGE_LINES] for k in range(0, len(rows), _PAGE_LINES)]
    return "\f".join("".join(f"{row}\r\n" for row in page) for page in pages)
