"""Warming up runs the kernels that a method will need."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_emvs import image_speed, threads
from roller_emvs.depth_settings import METHODS, DepthSettings
from roller_emvs.evidence import _meet_kernels, _pixel_kernels
from roller_emvs.evidence import _part_kernels as _image_kernels
from roller_emvs.lines import _place_kernels, patch_ends, path_error, refine
from roller_emvs.lines.fit import Lines, fit_lines
from roller_emvs.methods.paper import _view_kernels, _vote_kernels
from roller_emvs.methods.surface import SurfaceSettings, _part_kernels
from roller_emvs.warm_up import warm_up


@pytest.mark.parametrize("method", METHODS)
def test_every_method_warms_up(method: str) -> None:
    warm_up(DepthSettings.create({"method": method}))
    if method == "focus":
        assert _pixel_kernels._choose.signatures
        assert _image_kernels._support.signatures
        assert _meet_kernels._ground.signatures
        assert _place_kernels._move.signatures
    else:
        assert _vote_kernels._sweep_bands.signatures
    if method in ("bma", "left_right"):
        assert _view_kernels._sweep_bands_views.signatures


@pytest.mark.parametrize("method", [*METHODS, "surface"])
def test_it_asks_no_other_thread(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What another thread compiles ends by no interrupt: a node would have to be killed."""

    def refuse() -> ThreadPoolExecutor:
        raise AssertionError("another thread is asked for")

    monkeypatch.setattr(threads, "_pool", refuse)
    settings = SurfaceSettings if method == "surface" else DepthSettings
    warm_up(settings.create({} if method == "surface" else {"method": method}))


@pytest.mark.parametrize("kind", [DepthSettings, SurfaceSettings])
def test_what_a_texture_asks_for_is_warm(
    kind: type[DepthSettings | SurfaceSettings], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the first scan under one compiles it, as that of the demonstration did."""
    looked: list[None] = []
    monkeypatch.setattr(patch_ends, "_add_beside", lambda *_: looked.append(None))
    warm_up(kind.create({}))
    assert looked


def test_the_speed_of_the_image_is_warm_however_many_events_tell_it() -> None:
    """Every other one of many, or all of few."""
    warm_up(DepthSettings.create({}))
    before = len(image_speed._keep_quiet.signatures)
    camera = Camera(64, 48, 100.0, 100.0, 31.5, 23.5)
    speed = image_speed.ImageSpeed(camera, PoseTrack(), 0.04, 0.05)
    for step in (1, 2):
        zeros = np.zeros(1000, np.uint16)[::step]
        speed._quiet(
            EventArray(zeros, zeros, np.zeros(len(zeros), np.int64), zeros.astype(np.uint8))
        )
    assert len(image_speed._keep_quiet.signatures) == before > 0


def test_surface_warms_up_and_fits_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else the first scan after an installation compiles them in its middle."""
    fitted: list[int] = []

    def counted(*words: Any) -> Lines:
        found = fit_lines(*words)
        fitted.append(len(found))
        return found

    monkeypatch.setattr(refine, "fit_lines", counted)
    warm_up(SurfaceSettings.create({}))
    for kernel in (_part_kernels._gather, _pixel_kernels._choose, _place_kernels._move):
        assert kernel.signatures
    for kernel in (patch_ends._add_beside, path_error._add_apart):  # of a texture
        assert kernel.signatures
    assert sum(fitted) > 20
