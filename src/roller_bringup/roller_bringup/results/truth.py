"""Errors against the known truth of a simulated scan, as the paper defines them.

Measured pixels inside the contact patch, depth against the exact depth of the skin; beside it
always the share of relief edges that were measured at all.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from roller_driver.virtual.truth import Truth
from roller_emvs.depth_map import DepthMap

#: Slope of the skin from which a pixel counts as relief edge.
EDGE_SLOPE = 0.35
#: An edge pixel counts as measured if a depth lies within this distance, px.
EDGE_REACH_PX = 2


@dataclass
class _Tally:
    errors_um: list[npt.NDArray[np.float32]] = field(default_factory=list)
    edges: int = 0
    measured_edges: int = 0


class TruthTally:
    """Collects errors by object over all depth maps.

    Parameters
    ----------
    truth : Truth
        Of the scan.
    """

    def __init__(self, truth: Truth) -> None:
        self.truth = truth
        self._tallies: dict[str, _Tally] = {name: _Tally() for name in truth.objects}
        self._all = _Tally()

    @classmethod
    def beside(cls, source: Path) -> TruthTally | None:
        """The tally for a bag that has its truth beside it; None for others."""
        if source.is_dir() and (source / "truth.yaml").is_file():
            return cls(Truth.load(source))
        return None

    def add(self, found: DepthMap) -> None:
        """Compare one depth map."""
        camera = self.truth.camera
        depth = self.truth.depth_image(found.stamp_ns).astype(np.float64)
        contact = self.truth.contact_mask(found.stamp_ns)
        dy, dx = np.gradient(depth)
        slope = np.hypot(dx * camera.fx, dy * camera.fy) / depth
        edges = (slope > EDGE_SLOPE) & contact
        measured = np.isfinite(found.depth)
        size = 2 * EDGE_REACH_PX + 1
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
        reached = cv2.dilate(measured.astype(np.uint8), disc) > 0
        error = (found.depth - depth) * 1e6
        position = self.truth.camera_positions(found.stamp_ns)[0]
        u = np.arange(camera.width)[None, :]
        v = np.arange(camera.height)[:, None]
        # The camera looks straight down: base x with u, base y against v.
        x = position[0] + (u - camera.cx) / camera.fx * depth
        y = position[1] - (v - camera.cy) / camera.fy * depth
        inside = measured & contact
        self._count(self._all, inside, edges, reached, error)
        for name, region in self.truth.objects.items():
            here = (x >= region.x0) & (x <= region.x1) & (y >= region.y0) & (y <= region.y1)
            self._count(self._tallies[name], inside & here, edges & here, reached, error)

    @staticmethod
    def _count(
        tally: _Tally,
        inside: npt.NDArray[np.bool_],
        edges: npt.NDArray[np.bool_],
        reached: npt.NDArray[np.bool_],
        error: npt.NDArray[np.float64],
    ) -> None:
        tally.errors_um.append(error[inside].astype(np.float32))
        tally.edges += int(edges.sum())
        tally.measured_edges += int((edges & reached).sum())

    def summary(self) -> dict[str, Any]:
        """By object and over all: points, errors in µm, share of relief edges measured."""
        found = {name: _figures(tally) for name, tally in self._tallies.items()}
        return {"objects": found, "all": _figures(self._all), "text": self.truth.text}


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
    share = tally.measured_edges / tally.edges if tally.edges else float("nan")
    out["edges_measured"] = round(share, 4)
    return out
