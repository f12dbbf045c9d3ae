"""Loading the kernels before the first events come: compiling takes seconds, once a machine."""

from __future__ import annotations

import numpy as np

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_emvs.lines.patch_ends import PatchEnds
from roller_emvs.lines.path_error import PathError
from roller_emvs.methods.surface import SurfaceSettings, SurfaceSweep

from .depth_settings import DepthSettings
from .pipeline import DepthPipeline

#: So sharp and with so many events that `surface` finds depths and fits lines to them.
_CAMERA = Camera(192, 48, 450.0, 450.0, 95.5, 23.5)
_EVENTS = 60_000
_END_NS = 100_000_000
_SPEED_M_NS = 3e-10
_DEPTH_M = 0.045
_ALONE = {"threads": 1}


def warm_up(settings: DepthSettings | SurfaceSettings) -> None:
    """Run a small made-up scan through a method, whatever comes of it.

    All of it on the caller's thread: kernels are compiled one after the other anyway, and no
    interrupt ends what another thread compiles.

    Parameters
    ----------
    settings : DepthSettings or SurfaceSettings
        Of the method that will run.
    """
    rng = np.random.default_rng(0)
    times = np.sort(rng.integers(0, _END_NS, _EVENTS))
    # Lines across the roll, 3 mm apart, at a depth in the middle of the usual range.
    pixels = rng.integers(0, _CAMERA.width, _EVENTS)
    place = _SPEED_M_NS * times + (pixels - _CAMERA.cx) / _CAMERA.fx * _DEPTH_M
    line = np.rint(place / 3e-3)
    pixels = np.rint((line * 3e-3 - _SPEED_M_NS * times) * _CAMERA.fx / _DEPTH_M + _CAMERA.cx)
    pixels = pixels.clip(0, _CAMERA.width - 1)
    # Each of one polarity: where both were all around, no lines would be fitted.
    events = EventArray.from_arrays(
        pixels, rng.integers(0, _CAMERA.height, _EVENTS), times, line % 2
    )
    engines: list[DepthPipeline | SurfaceSweep]
    if isinstance(settings, SurfaceSettings):
        small = settings.model_copy(update={"min_aperture_m": 0.0005, "block_m": 0.004} | _ALONE)
        engines = [SurfaceSweep(small, _CAMERA, _track(0.0))]
    else:
        whole = settings.changed({"window.rule": "all"} | _ALONE)
        # A slanted travel goes by rays, and has every view vote for itself.
        engines = [DepthPipeline(whole, _CAMERA, _track(slant)) for slant in (0.0, 0.3)]
    for engine in engines:
        engine.add_events(events)
        for _ in engine.results(flush=True):
            pass
    _look_at_texture()


def _look_at_texture() -> None:
    """What a printed texture alone asks for."""
    rays, surface = np.zeros((1, 4), np.float32), np.zeros((2, 4), np.float32)
    row, place, slopes = np.zeros(1, np.int64), np.zeros(1), (-0.2, 0.2)
    PatchEnds(slopes, _CAMERA.fx).look(rays, place, surface, row, place, place)
    path = PathError(slopes, _DEPTH_M)
    path.begin(0.0, 0.004)
    path.look(rays, 1.0, surface, (row, place, place), (0.0, 1e-4))


def _track(slant: float) -> PoseTrack:
    """Poses along x, and across by a share of that."""
    track = PoseTrack()
    for t_ns in range(0, _END_NS + 1, 4_000_000):
        x = _SPEED_M_NS * t_ns
        track.append(t_ns, [x, slant * x, 0.0], [0.0, 0.0, 0.0, 1.0])
    return track
