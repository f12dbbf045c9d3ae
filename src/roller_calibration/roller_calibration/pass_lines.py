"""What is fitted to the events of a recording's passes, pass by pass, without a correction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from roller_core.errors import RollerError
from roller_core.transforms import F64
from roller_emvs.lines.edge_drift import EdgeDriftSettings
from roller_emvs.lines.line_points import LinePoints
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep

from .pauses import without_pauses
from .recordings import Scan

#: Slope along the roll from which a line is on a wall.
WALL_SLOPE = 0.1


class EdgeDriftError(RollerError):
    """Gauges from which no drift can be had."""


@dataclass(frozen=True)
class PassLines:
    """Lines of a pass in its own frame: along the roll, across, and towards the camera, metres.

    `cloud` are the points in base of all passes of the recording; `kind` says whether lines are
    lines, or depths of neighbourhoods in their place; `travel` how fast the density of events
    changes along the crossing, at the median of what is on slopes; `printed` whether edges lie
    everywhere, as under a printed skin.
    """

    place: F64
    lines: LinePoints
    cloud: F64
    axes: F64
    kind: str = "lines"
    travel: float = 0.0
    printed: bool = False


def pass_lines(scan: Scan, settings: SurfaceSettings) -> Iterator[list[PassLines]]:
    """Lines of a recording's passes, without a correction, then depths: to, or to and fro.

    Under a printed skin depths come first.

    Raises
    ------
    EdgeDriftError
        If there are too few of either, or a pass goes in a third direction.
    """
    plain = settings.changed({"edge_drift": EdgeDriftSettings.create({})})
    depths: Found = []
    patches, lines = swept(scan, plain, depths)
    cloud = np.concatenate([np.empty((0, 3)), *(patch.points for patch in patches)])
    # Depths are of several edges, whose changes cancel: lines say more, if there are any.
    travel = _travel(lines or depths)
    printed = is_printed(patches)
    kinds = [("lines", lines), ("depths", depths)]
    # Under a printed skin lines are of specks, and the surface is measured by their depths.
    for kind, found in reversed(kinds) if printed else kinds:
        passes = passes_of(scan.name, found, kind, cloud, travel, printed)
        if passes:
            yield passes


#: Places in base, axes of the pass, and the lines: block by block.
Found = list[tuple[F64, F64, LinePoints]]


def swept(
    scan: Scan, settings: SurfaceSettings, depths: Found | None = None
) -> tuple[list[SurfacePatch], Found]:
    """The surface of a recording where it has points, and its lines; a list takes depths too.

    Pauses of the robot don't end a pass.
    """
    scan = without_pauses(scan)
    sweep = SurfaceSweep(settings, scan.camera, scan.track)
    lines: Found = []
    sweep.on_lines = lambda *own: lines.append(own)
    if depths is not None:
        sweep.on_depths = lambda *own: depths.append(own)
    sweep.add_events(scan.events)
    results = sweep.results(flush=True)
    return [r for r in results if isinstance(r, SurfacePatch) and len(r)], lines


def is_printed(patches: list[SurfacePatch]) -> bool:
    """Whether most of a surface's points are of blocks whose edges lie everywhere."""
    printed = sum(len(patch) for patch in patches if patch.textured)
    return 2 * printed > sum(map(len, patches))


def _travel(found: Found) -> float:
    """Median change of the events' density on slopes; 0 without any."""
    lean = [np.abs(own.lean[np.abs(own.slope) > WALL_SLOPE]) for _, _, own in found]
    every = np.concatenate([np.empty(0), *lean])
    return float(np.median(every)) if len(every) else 0.0


def passes_of(
    name: str,
    found: Found,
    kind: str = "lines",
    cloud: F64 | None = None,
    travel: float = 0.0,
    printed: bool = False,
) -> list[PassLines]:
    """What was found by pass.

    Raises
    ------
    EdgeDriftError
        If a pass goes in a third direction.
    """
    cloud = np.empty((0, 3)) if cloud is None else cloud
    found = [part for part in found if len(part[0])]
    if not found:
        return []
    along = np.array([own[:, 0] @ found[0][1][:, 0] for _, own, _ in found])
    if (np.abs(along) < 0.9).any():
        raise EdgeDriftError(f"{name}: passes in several directions; roll to and fro")
    passes = []
    for sign in (1.0, -1.0):
        own = [part for part, a in zip(found, along, strict=True) if a * sign > 0]
        if not own:
            continue
        axes = own[0][1]
        towards = np.column_stack([axes[:, 0], axes[:, 1], -axes[:, 2]])
        lines = LinePoints(
            **{
                name: np.concatenate([getattr(part, name) for _, _, part in own])
                for name in LinePoints.__dataclass_fields__
            }
        )
        place = np.concatenate([place for place, _, _ in own]) @ towards
        passes.append(PassLines(place, lines, cloud, towards, kind, travel, printed))
    return passes
