"""Errors against the known truth of a simulated scan, as the paper defines them.

Measured points inside the contact patch against the exact skin; beside it always the share of
relief edges that were measured at all. Stamps of events are later than what caused them by a
known delay, which a cell calibrates; here it is taken out: what is compared is depth, not place
along the roll.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from roller_emvs.depth_map import DepthMap
from roller_emvs.methods.surface import SurfacePatch
from roller_sim.relief import Region
from roller_sim.truth import Truth
from roller_sim.truth_files import truth_beside

if TYPE_CHECKING:
    from typing import Self

#: Slope of the skin from which a place counts as relief edge.
EDGE_SLOPE = 0.35
#: An edge counts as measured if a depth lies within this distance, px.
EDGE_REACH_PX = 2
_SIZE = 2 * EDGE_REACH_PX + 1
_DISC = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_SIZE, _SIZE))

Mask = npt.NDArray[np.bool_]


@dataclass
class _Tally:
    errors_um: list[npt.NDArray[np.float32]] = field(default_factory=list)
    near_edge_um: list[npt.NDArray[np.float32]] = field(default_factory=list)
    edges: int = 0
    measured_edges: int = 0

    def count(self, errors_um: npt.NDArray[np.floating], near_edge: Mask) -> None:
        """Take errors, of which some lie near an edge."""
        self.errors_um.append(errors_um.astype(np.float32))
        self.near_edge_um.append(errors_um[near_edge].astype(np.float32))


class _Tallies:
    """What both kinds of tally begin with."""

    def __init__(self, truth: Truth, delay_s: float = 0.0) -> None:
        self.truth = truth
        self._delay_ns = truth.event_delay_ns - round(delay_s * 1e9)

    @classmethod
    def beside(cls, source: Path, delay_s: float = 0.0) -> Self | None:
        """The tally for a bag that has its truth beside it; None for others."""
        truth = truth_beside(source)
        return None if truth is None else cls(truth, delay_s)


class TruthTally(_Tallies):
    """Collects errors of depth maps by object.

    Parameters
    ----------
    truth : Truth
        Of the scan.
    delay_s : float
        What was taken out of the event stamps already, seconds.
    """

    def __init__(self, truth: Truth, delay_s: float = 0.0) -> None:
        super().__init__(truth, delay_s)
        self._tallies: dict[str, _Tally] = {name: _Tally() for name in truth.objects}
        self._all = _Tally()

    def add(self, found: DepthMap) -> None:
        """Compare one depth map."""
        seen_ns = found.stamp_ns - self._delay_ns
        camera = self.truth.camera
        seen, contact = self.truth.seen_images(seen_ns)
        depth = seen.astype(np.float64)
        dy, dx = np.gradient(depth)
        slope = np.hypot(dx * camera.fx, dy * camera.fy) / depth
        edges = (slope > EDGE_SLOPE) & contact
        measured = np.isfinite(found.depth)
        reached, near = _grown(measured), _grown(edges)
        error = (depth - found.depth) * 1e6  # + is too high, as of points
        x, y = self.truth.places(seen_ns, depth)
        for tally, here in self._places(x, y):
            inside = measured & contact & here
            tally.count(error[inside], near[inside])
            tally.edges += int((edges & here).sum())
            tally.measured_edges += int((edges & here & reached).sum())

    def _places(self, x: np.ndarray, y: np.ndarray) -> list[tuple[_Tally, Mask]]:
        """Tallies and what belongs to them of some points in base."""
        objects = self.truth.objects
        own = [(self._tallies[name], region.contains(x, y)) for name, region in objects.items()]
        return [(self._all, np.ones(np.shape(x), bool)), *own]

    def summary(self) -> dict[str, Any]:
        """By object and over all: points, errors in µm, share of relief edges measured."""
        found = {name: _figures(tally) for name, tally in self._tallies.items()}
        return {"objects": found, "all": _figures(self._all), "text": self.truth.text}


class SurfaceTally(_Tallies):
    """Collects errors of surface points by object: height against the skin at their place.

    Parameters
    ----------
    truth : Truth
        Of the scan.
    delay_s : float
        What was taken out of the event stamps already, seconds.
    regions : mapping of Region, optional
        What is counted apart; without them the scan's objects.
    """

    def __init__(
        self, truth: Truth, delay_s: float = 0.0, regions: Mapping[str, Region] | None = None
    ) -> None:
        super().__init__(truth, delay_s)
        self._regions = dict(truth.objects if regions is None else regions)
        self._points: list[npt.NDArray[np.float64]] = []

    def add(self, found: SurfacePatch) -> None:
        """Take points that are done."""
        self.add_points(found.points, found.stamp_ns)

    def add_points(self, points: npt.NDArray[np.float64], stamp_ns: int) -> None:
        """Take points in base, shape (n, 3), metres, that were seen at a time, ROS time."""
        if len(points):
            # Back along the path that the sensor made during the events' delay.
            before, after = self.truth.camera_positions([stamp_ns - self._delay_ns, stamp_ns])
            self._points.append(points - (after - before))

    @property
    def points(self) -> npt.NDArray[np.float64]:
        """All points taken, where they were seen, shape (n, 3), metres."""
        return np.concatenate(self._points) if self._points else np.empty((0, 3))

    def summary(self) -> dict[str, Any]:
        """By object and over all: points, errors in µm, share of relief edges measured."""
        tallies = {name: self._tally(r, self.points) for name, r in self._regions.items()}
        total = _Tally()
        for tally in tallies.values():
            total.errors_um += tally.errors_um
            total.near_edge_um += tally.near_edge_um
            total.edges += tally.edges
            total.measured_edges += tally.measured_edges
        if not tallies:
            own = self._passed_over()
            total.count(self._errors_um(own), np.zeros(len(own), bool))
        figures = {name: _figures(tally) for name, tally in tallies.items()}
        return {"objects": figures, "all": _figures(total), "text": self.truth.text}

    def _passed_over(self) -> npt.NDArray[np.float64]:
        """Points where the camera was above: all that counts of a plate without objects."""
        points, start_ns = self.points, self.truth.start_ros_ns
        ends = self.truth.camera_positions([start_ns, start_ns + self.truth.duration_ns])[:, 0]
        return points[(points[:, 0] >= ends.min()) & (points[:, 0] <= ends.max())]

    def _errors_um(self, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return (points[:, 2] - self.truth.height_at(points[:, 0], points[:, 1])) * 1e6

    def _tally(self, region: Region, points: npt.NDArray[np.float64]) -> _Tally:
        """Errors within an object, on a grid of the camera's pixels on the surface."""
        camera = self.truth.camera
        step = self.truth.path.height_m / max(camera.fx, camera.fy)
        # Two cells at least, which a slope takes.
        ends = max(region.x1, region.x0 + 1.5 * step), max(region.y1, region.y0 + 1.5 * step)
        x, y = np.meshgrid(np.arange(region.x0, ends[0], step), np.arange(region.y0, ends[1], step))
        dy, dx = np.gradient(self.truth.height_at(x, y), step)
        edges = np.hypot(dx, dy) > EDGE_SLOPE
        own = points[region.contains(points[:, 0], points[:, 1])]
        rows = np.rint((own[:, 1] - region.y0) / step).astype(np.int64).clip(0, x.shape[0] - 1)
        columns = np.rint((own[:, 0] - region.x0) / step).astype(np.int64).clip(0, x.shape[1] - 1)
        measured = np.zeros(edges.shape, bool)
        measured[rows, columns] = True
        tally = _Tally()
        tally.count(self._errors_um(own), _grown(edges)[rows, columns])
        tally.edges = int(edges.sum())
        tally.measured_edges = int((edges & _grown(measured)).sum())
        return tally


def _grown(mask: Mask) -> Mask:
    """Places within the reach of an edge."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), _DISC) > 0)


def _figures(tally: _Tally) -> dict[str, Any]:
    errors = np.concatenate(tally.errors_um) if tally.errors_um else np.empty(0, np.float32)
    out: dict[str, Any] = {"points": len(errors)}
    if len(errors):
        out |= {
            "mae_um": round(float(np.abs(errors).mean()), 2),
            "median_um": round(float(np.median(np.abs(errors))), 2),
            "bias_um": round(float(np.median(errors)), 2),
            "within_100_um": round(float((np.abs(errors) < 100).mean()), 4),
        }
        near = np.concatenate(tally.near_edge_um)
        if len(near):
            out["near_edge_mae_um"] = round(float(np.abs(near).mean()), 2)
    share = tally.measured_edges / tally.edges if tally.edges else float("nan")
    out["edges_measured"] = round(share, 4)
    return out
