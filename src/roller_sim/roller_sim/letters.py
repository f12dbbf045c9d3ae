"""Raised letters made of strokes: the same on every machine, with no font to depend on."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .errors import SceneError
from .relief import F64, Plate

# Strokes on a grid 4 wide and 6 high; each point is its two coordinates, y upwards.
_STROKES = {
    "A": "002640 1232",
    "B": "00063645443303 3342413000",
    "C": "4536160501103041",
    "D": "00062644422000",
    "E": "46060040 0333",
    "F": "460600 0333",
    "G": "45361605011030414323",
    "H": "0006 4046 0343",
    "I": "2026 1030 1636",
    "J": "4641301001",
    "K": "0006 460340",
    "L": "060040",
    "M": "0006234640",
    "N": "00064046",
    "O": "103041453616050110",
    "P": "00063645443303",
    "Q": "103041453616050110 2240",
    "R": "00063645443303 2340",
    "S": "453616050413334241301001",
    "T": "2026 0646",
    "U": "060110304146",
    "V": "062046",
    "W": "0610233046",
    "X": "0640 0046",
    "Y": "062346 2320",
    "Z": "06460040",
    "0": "103041453616050110 1135",
    "1": "152620 1030",
    "2": "05163645440040",
    "3": "0516364544334241301001 1333",
    "4": "3036 360242",
    "5": "460604344341301001",
    "6": "453616050110304142331302",
    "7": "064610",
    "8": "13040516364544331302011030414233",
    "9": "011030414536160504133344",
}
_WIDTH_UNITS, _HEIGHT_UNITS = 4, 6


def letter_width_mm(height_mm: float) -> float:
    """Width of a letter from stroke middle to stroke middle."""
    return height_mm * _WIDTH_UNITS / _HEIGHT_UNITS


def put_letter(
    plate: Plate, letter: str, x0: float, size: float, stroke: float, relief: float, name: str
) -> None:
    """Put one raised letter on a plate, centred across it.

    Parameters
    ----------
    plate : Plate
        The plate.
    letter : str
        A–Z or a digit.
    x0, size, stroke, relief : float
        Left edge, height of the letter, width of its strokes, height over the plate, mm.
    name : str
        Name of its region.

    Raises
    ------
    SceneError
        If the letter isn't known.
    """
    if letter not in _STROKES:
        raise SceneError(
            f"no letter shape for {letter!r}; a letter plate can show A–Z, 0–9, spaces"
        )
    unit = size / _HEIGHT_UNITS
    left = x0 + stroke / 2
    segments = []
    for word in _STROKES[letter].split():
        points = np.array([int(c) for c in word], float).reshape(-1, 2) * unit
        points += (left, -size / 2)
        segments += list(pairwise(points))

    def shape(x: F64, y: F64) -> F64:
        nearest = np.full(x.shape, np.inf)
        for (ax, ay), (bx, by) in segments:
            dx, dy = bx - ax, by - ay
            t = np.clip(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
            nearest = np.minimum(nearest, np.hypot(x - ax - t * dx, y - ay - t * dy))
        return np.where(nearest <= stroke / 2, relief, 0.0)

    x1 = x0 + letter_width_mm(size) + stroke
    half = (size + stroke) / 2
    plate.put(name, (x0, x1, -half, half), shape)
