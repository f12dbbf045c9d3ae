"""Braille Ready Format: cells as ASCII, pages of 25 lines of 40 cells (North American Braille)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

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
