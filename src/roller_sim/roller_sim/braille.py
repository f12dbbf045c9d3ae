"""Braille on plates: grade 1 letters, digits and spaces, and the dots' shape."""

from __future__ import annotations

import numpy as np

from .cell_settings import SceneSettings
from .errors import SceneError
from .relief import F64, BrailleMark, Plate, Region

_A_TO_J = (0x01, 0x03, 0x09, 0x19, 0x11, 0x0B, 0x1B, 0x13, 0x0A, 0x1A)
#: Distances of dots, cells and lines, and the base of a dot (those of the American NLS).
DOT_PITCH_MM, CELL_PITCH_MM, LINE_PITCH_MM, DOT_DIAMETER_MM = 2.34, 6.2, 10.0, 1.44
NUMBER_SIGN = 0x3C
LETTER_SIGN = 0x30


def _letter_masks() -> dict[str, int]:
    masks = {chr(ord("a") + i): m for i, m in enumerate(_A_TO_J)}
    masks |= {chr(ord("k") + i): m | 0x04 for i, m in enumerate(_A_TO_J)}
    # The third decade leaves out w, which Louis Braille's French alphabet didn't have.
    masks |= {c: m | 0x24 for c, m in zip("uvxyz", _A_TO_J, strict=False)}
    masks["w"] = 0x3A
    return masks


LETTERS = _letter_masks()
DIGITS = {str((i + 1) % 10): m for i, m in enumerate(_A_TO_J)}


def to_cells(text: str) -> list[tuple[int, str]]:
    """Braille cells of one line of print, grade 1.

    Parameters
    ----------
    text : str
        Letters a–z (capitals are written small), digits and spaces.

    Returns
    -------
    list of (int, str)
        Mask (dot 1 = bit 0 … dot 6 = bit 5) and the character it stands for, which is empty for
        the number sign and the letter sign.

    Raises
    ------
    SceneError
        If there is no cell for a character.
    """
    cells: list[tuple[int, str]] = []
    number = False
    for c in text.lower():
        if c in DIGITS:
            if not number:
                cells.append((NUMBER_SIGN, ""))
            number = True
            cells.append((DIGITS[c], c))
        elif c in LETTERS:
            if number and c <= "j":
                cells.append((LETTER_SIGN, ""))
            number = False
            cells.append((LETTERS[c], c))
        elif c == " ":
            number = False
            cells.append((0, " "))
        else:
            raise SceneError(
                f"no Braille for {c!r}; a plate can show letters a–z, digits and spaces"
            )
    return cells


def text_size_mm(text: str, settings: SceneSettings) -> tuple[float, float]:
    """Length and width that lines of text take up on the plate, from dot edge to dot edge, mm."""
    length, height = _block_mm(text)
    c, s = _turn(settings)
    across, down = length - DOT_DIAMETER_MM, height - DOT_DIAMETER_MM
    return (
        abs(c) * across + abs(s) * down + DOT_DIAMETER_MM,
        abs(s) * across + abs(c) * down + DOT_DIAMETER_MM,
    )


def _block_mm(text: str) -> tuple[float, float]:
    """Length and height of lines of text that aren't turned, mm."""
    lines = text.split("\n")
    longest = max(len(to_cells(line)) for line in lines)
    if not longest:
        raise SceneError("the Braille text is empty")
    length = (longest - 1) * CELL_PITCH_MM + DOT_PITCH_MM + DOT_DIAMETER_MM
    return length, (len(lines) - 1) * LINE_PITCH_MM + 2 * DOT_PITCH_MM + DOT_DIAMETER_MM


def _turn(settings: SceneSettings) -> tuple[float, float]:
    """Cosine and sine of the text's turn; exact where it isn't turned or is upside down."""
    if settings.turn_deg % 180.0 == 0.0:
        return 1.0 - 2.0 * (settings.turn_deg % 360.0 == 180.0), 0.0
    return float(np.cos(np.radians(settings.turn_deg))), float(
        np.sin(np.radians(settings.turn_deg))
    )


def put_braille(plate: Plate, text: str, x0_mm: float, settings: SceneSettings) -> str:
    """Put lines of Braille on a plate, centred across it, from `x0_mm` on.

    Returns
    -------
    str
        What the cells say: the text in small letters.

    Raises
    ------
    SceneError
        If the text can't be written or doesn't fit the plate.
    """
    lines = text.lower().split("\n")
    pitch, radius = DOT_PITCH_MM, DOT_DIAMETER_MM / 2
    length, wide = text_size_mm(text, settings)
    if wide > plate.width:
        raise SceneError(
            f"{len(lines)} Braille lines take up {wide:.1f} mm across but the plate is only "
            f"{plate.width:g} mm wide"
        )
    if x0_mm + length > plate.length + 1e-6:
        raise SceneError(f"Braille of {length:.1f} mm doesn't fit a plate of {plate.length:g} mm")
    block = _block_mm(text)[0]
    c, s = _turn(settings)

    def place(along: float, up: float) -> tuple[float, float]:
        """Where a place of the text, from its middle, lies on the plate."""
        return x0_mm + length / 2 + c * along - s * up, s * along + c * up

    for row, line in enumerate(lines):
        middle = ((len(lines) - 1) / 2 - row) * LINE_PITCH_MM
        for column, (mask, character) in enumerate(to_cells(line)):
            left = radius + column * CELL_PITCH_MM - block / 2
            for dot in range(6):
                if mask >> dot & 1:
                    x, y = place(left + dot // 3 * pitch, middle + (1 - dot % 3) * pitch)
                    _put_dot(plate, x, y, radius, settings.dot_height_mm)
            x, y = place(left + pitch / 2, middle)
            plate.marks.append(BrailleMark(x * 1e-3, y * 1e-3, mask, character, row, column))
    half = wide / 2
    plate.regions.append(
        Region("braille", x0_mm * 1e-3, (x0_mm + length) * 1e-3, -half * 1e-3, half * 1e-3)
    )
    return "\n".join(lines)


def _put_dot(plate: Plate, x: float, y: float, radius: float, height: float) -> None:
    sphere = (radius**2 + height**2) / (2 * height)

    def cap(px: F64, py: F64) -> F64:
        r_sq = (px - x) ** 2 + (py - y) ** 2
        top = np.sqrt(np.maximum(sphere**2 - r_sq, 0.0)) - (sphere - height)
        return np.where(r_sq <= radius**2, top, 0.0)

    plate.put("", (x - radius, x + radius, y - radius, y + radius), cap)
