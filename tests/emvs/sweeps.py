"""Sweeps in the surface's frame over analytic scenes, for tests."""

import numpy as np

from emvs.scenes import CAMERA
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_emvs.windows import RefusedWindow

DURATION_S = 0.12
VALUES = {"min_aperture_m": 0.013, "threads": 1}


def settings(**values: object) -> SurfaceSettings:
    return SurfaceSettings.create({**VALUES, **values})


def sweep(
    events: EventArray, track: PoseTrack, camera: Camera = CAMERA, **values: object
) -> tuple[list[SurfacePatch], list[RefusedWindow], SurfaceSweep]:
    engine = SurfaceSweep(settings(**values), camera, track)
    engine.add_events(events)
    found = list(engine.results(flush=True))
    patches = [f for f in found if isinstance(f, SurfacePatch)]
    return patches, [f for f in found if isinstance(f, RefusedWindow)], engine


def points_of(patches: list[SurfacePatch]) -> np.ndarray:
    return np.concatenate([p.points for p in patches]) if patches else np.empty((0, 3))
