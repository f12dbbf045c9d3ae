"""Findings as messages; importing this registers them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Point
from roller_msgs.msg import Finding as FindingMessage
from roller_msgs.msg import FindingArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from roller_core.outputs import Output
from roller_ros.messages import header, message_of

from .inspect_stage import FindingList, FindingMarkers
from .judgement import Judged

_COLOURS = {
    "conform": ColorRGBA(r=0.1, g=0.6, b=0.2, a=1.0),
    "inconclusive": ColorRGBA(r=0.95, g=0.65, b=0.1, a=1.0),
    "nonconform": ColorRGBA(r=0.85, g=0.1, b=0.1, a=1.0),
}
_SIZES = ("length", "width", "depth", "area", "volume")
_UNITS = {"area": "m2", "volume": "m3"}
#: Lines and letters of the markers, and how far above the surface they lie, m.
_LINE_M, _LETTER_M, _ABOVE_M = 1e-4, 1.5e-3, 2e-4


@message_of.register
def list_message(data: FindingList, output: Output) -> FindingArray:
    """Message of a part."""
    known = data.judgement
    return FindingArray(
        header=header(output.t_ns, output.frame_id),
        revision=data.revision,
        finished=data.finished,
        part=data.part,
        verdict=known.verdict,
        reason=known.reason,
        measured=known.coverage.measured,
        continued=known.coverage.continued,
        unmeasured=known.coverage.unmeasured,
        findings=[_finding(judged) for judged in known.findings],
    )


def _finding(judged: Judged) -> FindingMessage:
    found = judged.finding
    sizes: dict[str, float] = {}
    for size in _SIZES:
        name = f"{size}_{_UNITS.get(size, 'm')}"
        sizes[size] = float(getattr(found, name))
        sizes[f"{size}_uncertainty"] = float(getattr(found.uncertainty, name))
    return FindingMessage(
        id=found.id,
        kind=found.kind,
        region=judged.region,
        center=_point(found.center_m),
        outline=[_point(corner) for corner in found.outline_m],
        confidence=float(found.confidence),
        verdict=judged.verdict,
        final=found.final,
        **sizes,
    )


@message_of.register
def marker_message(shown: FindingMarkers, output: Output) -> MarkerArray:
    """Outlines, coloured by verdict, and labels for RViz, in place of all before."""
    clear = Marker(action=Marker.DELETEALL)
    clear.header.frame_id = output.frame_id
    markers = [clear]
    for judged in shown.findings:
        found = judged.finding
        outline, label = Marker(type=Marker.LINE_STRIP), Marker(type=Marker.TEXT_VIEW_FACING)
        for marker, part in ((outline, "outlines"), (label, "labels")):
            marker.header.frame_id = output.frame_id
            marker.ns = f"finding_{part}"
            marker.id = found.id
            marker.action = Marker.ADD
            marker.color = _COLOURS[judged.verdict]
            marker.pose.orientation.w = 1.0
        outline.scale.x = _LINE_M
        corners = [_point(corner, _ABOVE_M) for corner in found.outline_m]
        outline.points = corners + corners[:1]
        label.pose.position = _point(found.center_m, _LETTER_M)
        label.scale.z = _LETTER_M
        label.text = f"{found.id} {found.kind} {found.depth_m * 1e6:+.0f} µm"
        markers += [outline, label]
    return MarkerArray(markers=markers)


def _point(place: npt.NDArray[np.float64], above_m: float = 0.0) -> Point:
    return Point(x=float(place[0]), y=float(place[1]), z=float(place[2]) + above_m)
