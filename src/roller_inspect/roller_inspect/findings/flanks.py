"""Pieces of one hollow's flank, or of one rise's.

Of a wide flank that bends little, heights and their detail tell each a part. What one reaches from
another without coming up in between is the same hollow.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from .components import Component
from .cues import Cues
from .neighbourhood import ring_around

#: A piece is another's if a way leads there on which it stays as deep as this share of its own
#: depth above the level around.
_SHARE, _DEPTH_PERCENT = 0.7, 90
#: Ways lead no further from a piece than this, m.
_REACH_M = 3e-3


def joined(parts: list[Component], cues: Cues, step_m: float) -> list[Component]:
    """Components, with the pieces of one flank in one.

    Parameters
    ----------
    parts : list of Component
        All.
    cues : Cues
        What they were found by.
    step_m : float
        Edge of a cell.
    """
    known = cues.usable & np.isfinite(cues.fine_m)
    out = []
    for sign in (1, -1):
        depth = np.where(known, sign * cues.fine_m, -np.inf)
        own = [(_depth(part, depth), part) for part in parts if part.sign == sign]
        # The shallowest first: it may be a piece of one that is a piece itself.
        own.sort(key=lambda each: each[0])
        whole = [part for _, part in own]
        for k, (found, part) in enumerate(own):
            way = _way(part, found, depth, step_m)
            # Both that it lies between may be deeper: it is a piece of the one that it has most of.
            shared = [way.shared(other) if way else 0 for _, other in own[k + 1 :]]
            if any(shared):
                into = k + 1 + int(np.argmax(shared))
                whole[into] = _union(whole[k], whole[into])
            else:
                out.append(whole[k])
    return sorted(out, key=lambda c: (c.columns.start, c.rows.start, c.sign))


def _depth(part: Component, depth: npt.NDArray[np.floating]) -> float:
    """How deep a component is, m."""
    of_cells = depth[part.rows, part.columns][part.mask]
    of_cells = of_cells[np.isfinite(of_cells)]
    return float(np.percentile(of_cells, _DEPTH_PERCENT)) if len(of_cells) else 0.0


def _way(
    part: Component, found_m: float, depth: npt.NDArray[np.floating], step_m: float
) -> Component | None:
    """Cells that a component leads to without coming up; None if it is none of a flank."""
    reach = round(_REACH_M / step_m)
    rows, columns = (
        slice(max(s.start - reach, 0), s.stop + reach) for s in (part.rows, part.columns)
    )
    here = depth[rows, columns]
    mask = part.placed(rows.start, columns.start, here.shape)
    _, level = ring_around(mask, here, step_m)
    if found_m <= level:
        return None
    deep = here > level + _SHARE * (found_m - level)
    _, labels = cv2.connectedComponents((deep | mask).view(np.uint8))
    return replace(
        part, rows=rows, columns=columns, mask=labels == labels[tuple(np.argwhere(mask)[0])]
    )


def _union(one: Component, other: Component) -> Component:
    """Cells of either."""
    rows, columns = (
        slice(min(a.start, b.start), max(a.start + n, b.start + m))
        for a, b, n, m in zip(
            (one.rows, one.columns), (other.rows, other.columns), one.mask.shape,
            other.mask.shape, strict=True,
        )
    )  # fmt: skip
    shape = rows.stop - rows.start, columns.stop - columns.start
    mask = np.logical_or(*(c.placed(rows.start, columns.start, shape) for c in (one, other)))
    return replace(other, rows=rows, columns=columns, mask=mask)
