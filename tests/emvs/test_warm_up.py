"""Warming up runs the kernels that a method will need."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from roller_emvs import threads
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
