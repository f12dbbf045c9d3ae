"""What the hard cases share: a small scan whose depth is known, and all methods as one function.

The camera's axes are those of base and the surface's depth depends on x alone, so a point's error
is its z less the depth at its x, whichever method it is from.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from emvs.scenes import MS, Motion, rolling
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import F64, quaternion_to_matrix
from roller_emvs.depth_map import DepthMap, back_project
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.windows import RefusedWindow

CAMERA = Camera(320, 40, 800.0, 800.0, 159.5, 19.5)
SPEED_M_S = 0.3
DURATION_S = 0.1
MIDDLE_M = 0.045
#: Travel in a window of each kind, m.
WINDOW_M = 0.010
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
#: Of the paper's methods `bma`: the others go through the same code with fewer views.
PAPER = ("bma",)
METHODS = ("focus", *PAPER)
ALL = (*METHODS, "surface")

#: Windows of the paper's methods hold the travel that those of focus do.
DEPTH = DepthSettings.create(
    {
        "window": {"time_s": WINDOW_M / SPEED_M_S, "travel_m": WINDOW_M},
        "paper": {"planes": 100, "median_px": 15, "threshold_c": 24.0, "full_scale_votes": 128.0},
        "threads": 1,
    }
)
SURFACE = SurfaceSettings.create({"min_aperture_m": 0.009, "threads": 1})

Depth = Callable[[F64], F64]


def pixel_m(
    travel_m: float = WINDOW_M, camera: Camera = CAMERA, depth_m: float = MIDDLE_M
) -> float:
    """Depth of one pixel of parallax, Z²/(F·B)."""
    return depth_m**2 / (camera.fx * travel_m)


def flat(depth_m: float) -> Depth:
    """A plate at one depth."""
    return lambda x: np.full(np.shape(x), depth_m)


def tilted(x: F64) -> F64:
    """A plate that rises along the roll, all of it in range."""
    return np.asarray(MIDDLE_M + 0.03 * (x - 0.015))


def line_positions(low_m: float = -0.012, high_m: float = 0.045, pitch_m: float = 0.0013) -> F64:
    """x of lines across the roll, so unevenly apart that no other depth aligns neighbours."""
    gaps = np.random.default_rng(5).uniform(0.5, 1.5, int((high_m - low_m) / pitch_m)) * pitch_m
    return np.asarray(low_m + np.cumsum(gaps))


def scan(
    motion: Motion | None = None,
    depth: Depth = tilted,
    duration_s: float = DURATION_S,
    camera: Camera = CAMERA,
    lines: F64 | None = None,
    step_s: float = 50e-6,
    share: float = 0.4,
) -> EventArray:
    """A share of the events wherever a point of a line enters another pixel of a moving camera."""
    motion = motion or rolling(SPEED_M_S)
    times = np.arange(0.0, duration_s, step_s)
    positions, quaternions = (np.array(part) for part in zip(*map(motion, times), strict=True))
    rotations = quaternion_to_matrix(quaternions)
    # Upright and along x alone, without distortion, every row sees the same.
    alike = not camera.is_distorted and not np.ptp(quaternions, axis=0).any()
    alike &= bool(np.allclose(rotations[0], np.eye(3))) and not positions[:, 1:].any()
    # Half a pixel apart along the lines, a little beyond the image.
    rows = np.array([camera.cy]) if alike else np.arange(-2.0, camera.height + 2.0, 0.5)
    found = []
    for line in line_positions() if lines is None else lines:
        z = float(depth(np.array([line]))[0])
        points = np.zeros((len(rows), 3))
        points[:, 0], points[:, 2] = line, z
        points[:, 1] = (rows - camera.cy) / camera.fy * z
        local = np.einsum("tji,tpj->tpi", rotations, points[None] - positions[:, None])
        seen = np.abs(local[..., 0]) < 0.75 * camera.width / camera.fx * local[..., 2]
        t, p = np.nonzero(seen & (local[..., 2] > 0))
        pixel = np.full((*seen.shape, 2), -1, np.int64)
        pixel[t, p] = np.rint(camera.project(local[t, p]))
        inside = (pixel >= 0).all(axis=2) & (pixel < (camera.width, camera.height)).all(axis=2)
        number = np.where(inside, pixel[..., 1] * camera.width + pixel[..., 0], -1)
        t, p = np.nonzero(inside[1:] & (number[1:] != number[:-1]))
        # Two points in a pixel are one event.
        found.append(np.unique(np.stack([t + 1, number[1:][t, p]]), axis=1))
    t, number = np.concatenate(found, axis=1)
    x, y = number % camera.width, number // camera.width
    if alike:
        t, x = np.repeat(t, camera.height), np.repeat(x, camera.height)
        y = np.tile(np.arange(camera.height), len(y))
    chosen = np.random.default_rng(7).random(len(t)) < share
    t, x, y = t[chosen], x[chosen], y[chosen]
    order = np.argsort(t, kind="stable")
    t_ns = np.rint(times[t[order]] * 1e9).astype(np.int64)
    return EventArray.from_arrays(x[order], y[order], t_ns, np.ones(len(t)))


def poses(
    motion: Motion | None = None,
    duration_s: float = DURATION_S,
    start_ns: int = 0,
    max_gap_s: float = 0.1,
) -> PoseTrack:
    """Poses at 125 Hz, one beyond the end."""
    motion, track = motion or rolling(SPEED_M_S), PoseTrack(max_gap_s)
    for k in range(int(duration_s / 0.008) + 3):
        track.append(start_ns + k * 8 * MS, *motion(k * 0.008))
    return track


def run(
    method: str, events: EventArray, track: PoseTrack, camera: Camera = CAMERA, **values: object
) -> list[DepthMap | SurfacePatch | RefusedWindow]:
    """All that a method makes of a whole recording."""
    engine: DepthPipeline | SurfaceSweep
    if method == "surface":
        engine = SurfaceSweep(SURFACE.changed(values), camera, track)
    else:
        engine = DepthPipeline(DEPTH.changed({"method": method, **values}), camera, track)
    engine.add_events(events)
    return list(engine.results(flush=True))


def points_of(found: list[DepthMap | SurfacePatch | RefusedWindow], camera: Camera = CAMERA) -> F64:
    """Measured points in base, shape (n, 3)."""
    parts = [np.empty((0, 3))]
    for result in found:
        if isinstance(result, DepthMap):
            local, _ = back_project(result.depth, camera)
            parts.append(local @ result.pose[:3, :3].T + result.pose[:3, 3])
        elif isinstance(result, SurfacePatch):
            parts.append(result.points)
    return np.concatenate(parts)


def maps_of(found: list[DepthMap | SurfacePatch | RefusedWindow]) -> list[DepthMap]:
    """The depth maps among the results."""
    return [f for f in found if isinstance(f, DepthMap)]


def refused_of(found: list[DepthMap | SurfacePatch | RefusedWindow]) -> list[RefusedWindow]:
    """The refusals among the results."""
    return [f for f in found if isinstance(f, RefusedWindow)]


def pending(methods: Iterable[str], but: Iterable[str], reason: str) -> list[Any]:
    """Methods as parameters; those of `but` don't keep the promise yet."""
    return [pytest.param(m, marks=not_yet(reason)) if m in but else m for m in methods]


def not_yet(reason: str) -> pytest.MarkDecorator:
    """A promise that is not kept: the assertion fails, and nothing else goes wrong."""
    failures = (AssertionError, pytest.fail.Exception)
    return pytest.mark.xfail(strict=True, raises=failures, reason=reason)


def errors_px(points: F64, depth: Depth = tilted, one_pixel_m: float | None = None) -> F64:
    """Errors of depth in pixels of parallax."""
    return np.asarray((points[:, 2] - depth(points[:, 0])) / (one_pixel_m or pixel_m()))


def assert_right(
    points: F64,
    depth: Depth = tilted,
    at_least: int = 50,
    one_pixel_m: float | None = None,
    typical_px: float = 0.5,
    wrong_share: float = 0.05,
) -> None:
    """Typical depths are right to half a pixel of parallax, few are off by more than two."""
    assert len(points) >= at_least
    errors = np.abs(errors_px(points, depth, one_pixel_m))
    assert np.median(errors) < typical_px
    assert np.mean(errors > 2.0) < wrong_share
