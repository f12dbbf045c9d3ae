"""Places of dense edges in a scan that shows little else."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from roller_inspect.height_map.height_map import F32, MEASURED, OUTSIDE, Bools, HeightMap
from roller_inspect.height_map.medians import spread_blocks

from .smoothing import block_means

#: From this share of known cells on a scan counts as one that shows all of the surface.
DENSE_SHARE = 0.5
#: Edges are dense where points within a Gaussian of this standard deviation, m, are this many a m²,
#: and so many times as many as is usual within the wider one. A place of them is a finding if it
#: has so many points, and their deviation a median of this, m: what trails behind strong edges lies
#: on the reference. Tuned on the virtual cell, plain coating.
_EDGES_M, _WIDE_M, _DENSE_PER_M2, _TIMES = 3e-4, 4e-3, 8e6, 8.0
_EDGE_POINTS, _EDGE_DEVIATION_M, _LEAST_AROUND = 15, 3e-5, 5


def dense_edges(height_map: HeightMap, height_m: F32, usable: Bools) -> npt.NDArray[np.int8]:
    """Where a scan that shows little else shows many edges that lie higher, 1, or lower, −1."""
    found = np.zeros(height_map.shape, np.int8)
    inside = height_map.state != OUTSIDE
    if not usable.any() or height_map.known[inside].mean() > DENSE_SHARE:
        return found
    step = height_map.step_m
    points = height_map.points.astype(np.float32)
    near = cv2.GaussianBlur(points, (0, 0), _EDGES_M / step, borderType=cv2.BORDER_CONSTANT)
    dense = usable & (
        near > step**2 * max(_DENSE_PER_M2, _TIMES * usual_density(points, inside, step))
    )
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(dense.astype(np.uint8))
    enough = np.bincount(labels[dense], points[dense], len(boxes)) >= _EDGE_POINTS
    measured = (height_map.state == MEASURED) & np.isfinite(height_m)
    reach = round(_WIDE_M / step)
    for number in np.flatnonzero(enough[1:]) + 1:
        x, y, width, height, _ = boxes[number]
        window = (
            slice(max(y - reach, 0), y + height + reach),
            slice(max(x - reach, 0), x + width + reach),
        )
        own, heights = labels[window] == number, height_m[window]
        here, around = own & measured[window], measured[window] & ~dense[window]
        if here.any() and around.sum() >= _LEAST_AROUND:
            off = np.median(heights[here]) - np.median(heights[around])
            if abs(off) >= _EDGE_DEVIATION_M:
                found[window][own] = np.sign(off)
    return found


def usual_density(points: F32, inside: Bools, step_m: float) -> float:
    """Median of the points a m² within the wider Gaussian, which blocks of an eighth tell."""
    k = max(1, round(_WIDE_M / step_m / 8))
    reach = _WIDE_M / step_m / k
    wide = cv2.GaussianBlur(block_means(points, k), (0, 0), reach, borderType=cv2.BORDER_CONSTANT)
    return float(np.median(spread_blocks(wide, k, inside.shape)[inside])) / step_m**2
