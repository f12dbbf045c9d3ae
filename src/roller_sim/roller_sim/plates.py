"""Larger plates: line arrays, letters with defects, rivets. Lengths in millimetres."""

from __future__ import annotations

import numpy as np

from .cell_settings import SceneSettings
from .errors import SceneError
from .letters import letter_width_mm, put_letter
from .relief import F64, Plate, Scene

LINE_WIDTH, LINE_PITCH, LINE_LENGTH = 1.0, 3.0, 15.0
THREE_WIDTH, THREE_PITCH, THREE_HEIGHT = 1.5, 5.0, 0.6
LETTER_SIZE, LETTER_STROKE, LETTER_GAP = 7.0, 1.0, 1.6
SCRATCH_WIDTH, SCRATCH_DEPTH = 0.4, 0.25
RIVET_RADIUS, RIVET_RISE, GROOVE_WIDTH, GROOVE_DEPTH = 4.0, 0.05, 0.4, 0.3
RIVET_TILT = 0.6
DEFAULT_LETTERS = "NOTICE"
PLATE_PRESS = 1.8


def new_plate(settings: SceneSettings, objects_mm: float) -> Plate:
    """A flat plate with room for objects of a total length between its margins."""
    length = max(2 * settings.margin_mm + objects_mm, settings.length_mm, 2.0)
    return Plate(length, settings.width_mm, settings.step_mm)


def _put_bar(plate: Plate, name: str, x0: float, width: float, height: float) -> None:
    half = LINE_LENGTH / 2
    plate.put(name, (x0, x0 + width, -half, half), lambda x, y: height)


def line_array(settings: SceneSettings) -> Scene:
    """Twelve bars across the roll, 0.1 to 1.2 mm high."""
    plate = new_plate(settings, 11 * LINE_PITCH + LINE_WIDTH)
    for i in range(12):
        height = 0.1 * (i + 1)
        _put_bar(
            plate, f"line_{height:.1f}", settings.margin_mm + i * LINE_PITCH, LINE_WIDTH, height
        )
    return plate.scene("line_array", PLATE_PRESS)


def three_lines(settings: SceneSettings) -> Scene:
    """Three equal bars, 0.6 mm high."""
    plate = new_plate(settings, 2 * THREE_PITCH + THREE_WIDTH)
    for i in range(3):
        x0 = settings.margin_mm + i * THREE_PITCH
        _put_bar(plate, f"line_{i + 1}", x0, THREE_WIDTH, THREE_HEIGHT)
    return plate.scene("three_lines", PLATE_PRESS)


def letter_plate(settings: SceneSettings) -> Scene:
    """Letters 0.4 to 0.6 mm high, with scratches and a fault in the model of a letter.

    Scratches run across the first I, the first E and the top of the first T (where the text has
    them); a piece is missing from the side of the first T.

    Raises
    ------
    SceneError
        If the text is empty or has a letter that isn't known.
    """
    text = (settings.text or DEFAULT_LETTERS).upper()
    if not text.strip():
        raise SceneError("the letter plate's text is empty")
    advance = letter_width_mm(LETTER_SIZE) + LETTER_STROKE + LETTER_GAP
    plate = new_plate(settings, len(text) * advance - LETTER_GAP)
    places: dict[str, float] = {}
    for i, letter in enumerate(text):
        x0 = settings.margin_mm + i * advance
        if letter != " ":
            relief = 0.4 + 0.05 * (i % 5)
            name = f"letter_{i + 1}_{letter}"
            put_letter(plate, letter, x0, LETTER_SIZE, LETTER_STROKE, relief, name)
            places.setdefault(letter, x0)
    middle = (letter_width_mm(LETTER_SIZE) + LETTER_STROKE) / 2
    if "I" in places:
        _scratch(plate, "scratch_I", places["I"] + middle, 0.8, 0.9, 35.0)
    if "E" in places:
        _scratch(plate, "scratch_E", places["E"] + LETTER_STROKE / 2, -1.6, 0.9, -30.0)
    if "T" in places:
        _scratch(plate, "scratch_T", places["T"] + middle + 1.1, LETTER_SIZE / 2, 0.9, 60.0)
        x1 = places["T"] + middle
        plate.put("fault_T", (x1, x1 + 0.5, -1.2, -0.4), lambda x, y: 0.0, join="set")
    return plate.scene("letter_plate", PLATE_PRESS)


def _scratch(plate: Plate, name: str, x: float, y: float, half_mm: float, angle_deg: float) -> None:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    reach = half_mm + SCRATCH_WIDTH

    def groove(px: F64, py: F64) -> F64:
        along = np.abs((px - x) * c + (py - y) * s)
        across = np.abs(-(px - x) * s + (py - y) * c)
        inside = (along <= half_mm) & (across <= SCRATCH_WIDTH / 2)
        return np.where(inside, -SCRATCH_DEPTH * (1 - 2 * across / SCRATCH_WIDTH), 0.0)

    plate.put(name, (x - reach, x + reach, y - reach, y + reach), groove, join="add")


def put_rivet(
    plate: Plate,
    name: str,
    at: tuple[float, float],
    radius: float,
    groove_width: float,
    tilt: float,
) -> None:
    """A countersunk rivet: a head of a radius, `tilt` higher on one side, and a groove around."""
    (xc, yc), reach = at, radius + groove_width

    def head(x: F64, y: F64) -> F64:
        r = np.hypot(x - xc, y - yc)
        top = RIVET_RISE + tilt * (1 + (x - xc) / radius) / 2
        groove = -GROOVE_DEPTH * np.clip(
            1 - np.abs(r - radius - groove_width / 2) * 2 / groove_width, 0.0, 1.0
        )
        return np.where(r <= radius, top, np.where(r < reach, groove, 0.0))

    plate.put(name, (xc - reach, xc + reach, yc - reach, yc + reach), head, join="set")


def _rivet(settings: SceneSettings, name: str, tilt_mm: float) -> Scene:
    reach = RIVET_RADIUS + GROOVE_WIDTH
    plate = new_plate(settings, 2 * reach)
    at = settings.margin_mm + reach, 0.0
    put_rivet(plate, "rivet", at, RIVET_RADIUS, GROOVE_WIDTH, tilt_mm)
    return plate.scene(name, PLATE_PRESS)


def rivet_flush(settings: SceneSettings) -> Scene:
    """A countersunk rivet as it should be: flat head, level with the skin of the plate."""
    return _rivet(settings, "rivet_flush", 0.0)


def rivet_bent(settings: SceneSettings) -> Scene:
    """The same rivet set askew: one side stands out."""
    return _rivet(settings, "rivet_bent", RIVET_TILT)
