"""Braille cells as messages, the same for the node and for a replay's bag."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Point, Vector3
from roller_msgs.msg import BrailleCell
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import Marker

from roller_ros.messages import header

from .cells import Cell
from .reader_settings import Spacing
from .table import UNREADABLE

_READ = ColorRGBA(r=0.1, g=0.7, b=0.2, a=1.0)
_UNREAD = ColorRGBA(r=0.9, g=0.3, b=0.1, a=1.0)


def cell_message(cell: Cell, frame_id: str, first_line: int = 0) -> BrailleCell:
    """Message of one cell; `first_line` lines were read before its text began."""
    return BrailleCell(
        header=header(cell.stamp_ns, frame_id),
        line=cell.line + first_line,
        column=cell.column,
        mask=cell.mask,
        pattern=cell.pattern,
        character=cell.character,
        readable=cell.readable,
        position=_point(cell.position),
        confidence=cell.confidence,
        dot_confidence=np.array(cell.dot_confidence, np.float32),
    )


def text_message(lines: Sequence[str]) -> String:
    """Message of all lines read so far."""
    return String(data="\n".join(lines))


def cell_markers(cell: Cell, number: int, frame_id: str, spacing: Spacing) -> list[Marker]:
    """A cell's character and its raised dots for RViz; none for a blank cell.

    Parameters
    ----------
    cell : Cell
        What was read.
    number : int
        Identity of the markers; no two cells may share one.
    frame_id : str
        Frame of the cell's position.
    spacing : Spacing
        Sizes of dots and letters.
    """
    if not cell.mask and cell.readable:
        return []
    letter, dots = Marker(type=Marker.TEXT_VIEW_FACING), Marker(type=Marker.SPHERE_LIST)
    for marker, part in ((letter, "characters"), (dots, "dots")):
        marker.header.frame_id = frame_id
        marker.ns = f"braille_{part}"
        marker.id = number
        marker.action = Marker.ADD
        marker.color = _READ if cell.readable else _UNREAD
        marker.pose.orientation.w = 1.0
    letter.pose.position = _point(cell.position)
    # Above the surface, so that the dots stay in sight.
    letter.pose.position.z += spacing.dot_pitch_m
    letter.scale.z = 2 * spacing.dot_pitch_m
    letter.text = cell.character or (cell.pattern if cell.readable else UNREADABLE)
    size = spacing.dot_diameter_m
    dots.scale = Vector3(x=size, y=size, z=size)
    dots.points = [_point(p) for i, p in enumerate(cell.dot_positions) if cell.mask >> i & 1]
    return [letter, dots]


def _point(position: npt.NDArray[np.float64]) -> Point:
    return Point(x=float(position[0]), y=float(position[1]), z=float(position[2]))
