"""Depth from neighbourhood evidence: the plane on which the warped events are sharpest.

A single pixel's vote count hardly changes with depth where an edge is as wide as the parallax.
The sharpness of the votes over a neighbourhood does. Planes are spaced by parallax, evenly in
inverse depth, and the peak is found between planes; see `evidence`.

Of a window with many events, whose motion shifts the image along its rows or columns, each event
votes once, in the image of its part of the aperture (`evidence.part_images`). Any other motion,
and few events, go by their rays.

Where few edges lie apart, and events saw them over most of a crossing, lines are fitted to these
and points follow them, as in `surface`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from roller_core.camera import Camera
from roller_core.transforms import F64
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.evidence import (
    Depths,
    EvidenceField,
    RayField,
    Relief,
    find_depths,
    follow_wider,
    is_textured,
    measured_pixels,
)
from roller_emvs.evidence.part_images import find_depths_of_parts
from roller_emvs.lines.fit import LEAST_VARIANCE, NO_LINES, TEXTURE_ROW_STEP, fit_lines
from roller_emvs.lines.patch_ends import PatchEnds
from roller_emvs.lines.ray_source import RayArray
from roller_emvs.lines.refine import refine
from roller_emvs.lines.travelling_light import TravellingLight
from roller_emvs.rays import F32, Packets
from roller_emvs.stopwatch import Stopwatch
from roller_emvs.threads import share

from . import _focus_kernels as kernels
from .window_field import WindowView

#: Events of a window that are enough for its lines: every second, third or fourth is taken of more.
_ENOUGH, _MOST_LEFT_OUT = 75_000, 4
#: Events of a window from which the ends of the contact patch are looked for.
_FOR_ENDS = 400_000


class FocusDepth(NamedTuple):
    """Depth of a window in its reference view."""

    #: float32, shape (height, width): metres, 0-1 and metres; NaN where there is no depth.
    depth: F32
    confidence: F32
    sigma: F32
    #: Whether edges lie so close that neighbourhoods tell all, as under a printed texture.
    textured: bool


def focus_depth(
    packets: Packets,
    camera: Camera,
    view: F64,
    settings: DepthSettings,
    watch: Stopwatch,
    blind_m: float = 0.0,
    ends: PatchEnds | None = None,
    textured_before: bool = False,
) -> FocusDepth:
    """Depth of one window in a reference view.

    Parameters
    ----------
    packets : Packets
        Events of the window.
    camera : Camera
        Intrinsics.
    view : ndarray of float64, shape (4, 4)
        Reference camera in base.
    settings : DepthSettings
        Depth range, patch, threads and `focus`.
    watch : Stopwatch
        Takes the time by stage.
    blind_m : float
        Travel of the sensor while pixels are blind after an event, m; 0 where that doesn't matter.
    ends : PatchEnds, optional
        What is known of the ends of the contact patch; takes what this window tells of them.
    textured_before : bool
        Whether a window of this run was textured.

    Returns
    -------
    FocusDepth
        Depth, confidence and sigma of the reference view.
    """
    s = settings
    with watch("rays"):
        depths_m, half_m = (s.depth_min_m, s.depth_max_m), s.patch_half_length_m or np.inf
        edge = half_m / (0.5 * sum(depths_m))
        within = ends.ends if ends else (-edge, edge)
        seen = WindowView.of(packets, camera, view, depths_m, within)
    field, depths = _evidence(seen, s, watch)
    textured = is_textured(depths, textured_before)
    found = _points(seen, field, depths, s, watch, blind_m, ends, textured)
    shape, nothing = (camera.height, camera.width), np.float32(np.nan)
    depth, confidence, sigma = (np.full(shape, nothing) for _ in range(3))
    row, column = (found.column, found.row) if seen.turned else (found.row, found.column)
    kernels._write(
        row, column, found.offset, found.confidence, found.sigma, found.agreed, seen.middle,
        seen.half, depth, confidence, sigma,
    )  # fmt: skip
    return FocusDepth(depth, confidence, sigma, textured)


def _evidence(
    seen: WindowView, s: DepthSettings, watch: Stopwatch
) -> tuple[EvidenceField, list[Depths]]:
    """Events of a window, and depths on cells: by parts of the aperture where those are alike."""
    with watch("rays"):
        parts = seen.parts()
        field = seen.ray_field() if parts is None else seen.part_images(parts, s.threads)
    with watch("votes"):
        if isinstance(field, RayField):
            return field, find_depths(field, -seen.half, seen.half, s.focus, threads=s.threads)
        return field, find_depths_of_parts(field, -seen.half, seen.half, s.focus, s.threads)


def _points(
    seen: WindowView,
    field: EvidenceField,
    depths: list[Depths],
    s: DepthSettings,
    watch: Stopwatch,
    blind_m: float,
    ends: PatchEnds | None,
    textured: bool,
) -> Relief:
    """Measured pixels, moved by the lines around where they aren't of a texture."""
    spread = field.aperture * abs(field.ray_slope_scale)
    wide = spread**2 / 12 >= LEAST_VARIANCE  # else no line is one
    # Lines tell nothing of a texture that neighbourhoods don't, but where the patch ends.
    with_lines = wide and not textured
    look = wide and textured and ends is not None and not ends.known and not seen.turned
    with watch("points"):
        found = measured_pixels(
            field, depths, s.focus, s.edge_drift, s.threads, surfaces=with_lines or look,
            textured=textured, everywhere=True,
        )  # fmt: skip
        if look and ends is not None:
            _look_for(ends, seen, found, s.threads)
    if textured and s.average_flats:
        return follow_wider(found.whole(), field, s.focus, s.threads)
    if not with_lines:
        return found.whole()
    with watch("lines"):
        every = min(1 + len(seen.packets.events) // _ENOUGH, _MOST_LEFT_OUT)
        some = _some_rays(seen, field, every)
        columns, light = (0, field.shape[1]), TravellingLight()
        found, _ = refine(
            field, found, lambda k: RayArray(some(k)), columns, s.edge_drift, light, blind_m,
            s.threads, as_points=False, held=False,
        )  # fmt: skip
    return found


def _some_rays(seen: WindowView, field: EvidenceField, every: int) -> Callable[[int], F32]:
    """Takes a polarity and gives the rays of every n-th event; those of the field if it has any."""
    if isinstance(field, RayField):
        return partial(field.some, every=every)
    return replace(seen, packets=seen.packets.sample(every)).ray_field().some


def _look_for(ends: PatchEnds, seen: WindowView, found: Relief, threads: int) -> None:
    """See what a textured window tells of the ends of the contact patch."""
    packets = seen.packets.sample(max(len(seen.packets.events) // _FOR_ENDS, 1))
    field, events, c = replace(seen, packets=packets).ray_field(), packets.events, seen.camera
    rays = [field.rays[a:b] for a, b in pairwise(field.bounds)]
    columns = 0, field.shape[1]
    scales = field.offset_per_m, field.ray_slope_scale, field.direction
    lines = [NO_LINES, NO_LINES]

    def fit(k: int) -> None:
        surface = found.surfaces[k]
        lines[k] = fit_lines(RayArray(rays[k]), surface, columns, *scales, TEXTURE_ROW_STEP)

    share(threads, 2, fit)
    slopes = (packets.table[..., 0].astype(np.float64) - c.cx) / c.fx
    for k, own in enumerate(lines):
        of = events.p == k
        seen_at = slopes[events.y[of], events.x[of]]
        ends.look(rays[k], seen_at, found.surfaces[k], own.row, own.x, own.offset)
    ends.find()
