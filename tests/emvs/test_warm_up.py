"""Warming up runs the kernels that a method will need."""

import pytest

from roller_emvs.depth_settings import METHODS, DepthSettings
from roller_emvs.evidence import _meet_kernels, _pixel_kernels
from roller_emvs.evidence import _part_kernels as _image_kernels
from roller_emvs.lines import _place_kernels
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


def test_surface_warms_up() -> None:
    warm_up(SurfaceSettings.create({}))
    for kernel in (_part_kernels._gather, _pixel_kernels._choose):
        assert kernel.signatures
