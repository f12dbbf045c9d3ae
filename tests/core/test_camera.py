"""Telling one camera from another."""

from dataclasses import replace

import pytest

from roller_core.camera import Camera, CameraError

ONE = Camera(640, 480, 1066.0, 1067.0, 319.5, 239.5, (-0.2, 0.05))


def test_a_camera_has_its_own_figures() -> None:
    assert ONE.same_intrinsics(ONE.intrinsics)
    # What a calibration rounds, and coefficients that it leaves out.
    assert ONE.same_intrinsics([640.0, 480.0, 1066.01, 1066.99, 319.501, 239.5, -0.2, 0.05])
    plain = replace(ONE, distortion=())
    assert plain.same_intrinsics(plain.intrinsics[:6])


@pytest.mark.parametrize(
    "changes",
    [{"width": 320}, {"height": 240}, {"fx": 1070.0}, {"cy": 238.0}, {"distortion": (-0.2, 0.06)}],
)
def test_another_camera_has_not(changes: dict[str, float]) -> None:
    assert not ONE.same_intrinsics(replace(ONE, **changes).intrinsics)  # type: ignore[arg-type]


@pytest.mark.parametrize("figures", [(), (0.0,), (640.0, 480.0), (*ONE.intrinsics, 0.0)])
def test_no_list_of_figures_is_no_camera(figures: tuple[float, ...]) -> None:
    assert not ONE.same_intrinsics(figures)


@pytest.mark.parametrize("size", [(2049, 480), (640, 2**31), (2**32 - 1, 2**32 - 1)])
def test_no_camera_is_larger_than_memory(size: tuple[int, int]) -> None:
    """Whoever says so, as a stranger's camera_info or a file: tables and volumes would fill it."""
    with pytest.raises(CameraError, match="over 2048 px a side"):
        Camera(*size, 1000.0, 1000.0, 320.0, 240.0)
