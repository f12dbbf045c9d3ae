"""Braille cells as messages; importing this registers them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Point, Vector3
from roller_msgs.msg import BrailleCell
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from roller_core.outputs import Output
from roller_ros.messages import header, message_of

from .braille_stage import CellMarkers, NoMarkers
from .cells import Cell
from .table import UNREADABLE

_READ = ColorRGBA(r=0.1, g=0.7, b=0.2, a=1.0)
_UNREAD = ColorRGBA(r=0.9, g=0.3, b=0.1, a=1.0)


@message_of.register
def cell_message(cell: Cell, output: Output) -> BrailleCell:
    """Message of one cell."""
    return BrailleCell(
        header=header(output.t_ns, output.frame_id),
        line=cell.line,
        column=cell.column,
        mask=cell.mask,
        pattern=cell.pattern,
        character=cell.character,
        readable=cell.readable,
        position=_point(cell.position),
        confidence=cell.confidence,
        dot_confidence=np.array(cell.dot_confidence, np.float32),
    )


@message_of.register
def marker_message(shown: CellMarkers, output: Output) -> MarkerArray:
    """A cell's character and its raised dots for RViz; none for a blank cell."""
    cell, spacing = shown.cell, shown.spacing
    blank = not cell.mask and cell.readable
    if blank and not shown.again:
        return MarkerArray()
    letter, dots = Marker(type=Marker.TEXT_VIEW_FACING), Marker(type=Marker.SPHERE_LIST)
    for marker, part in ((letter, "characters"), (dots, "dots")):
        marker.header.frame_id = output.frame_id
        marker.ns = f"braille_{part}"
        marker.id = shown.number
        marker.action = Marker.DELETE if blank else Marker.ADD
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
    return MarkerArray(markers=[letter, dots])


@message_of.register
def no_markers_message(_: NoMarkers, output: Output) -> MarkerArray:
    """Takes away all that RViz shows of the topic."""
    marker = Marker(action=Marker.DELETEALL)
    marker.header.frame_id = output.frame_id
    return MarkerArray(markers=[marker])


def _point(position: npt.NDArray[np.float64]) -> Point:
    return Point(x=float(position[0]), y=float(position[1]), z=float(position[2]))
