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


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        ((1e5, 1e5, 319.5, 239.5), "focal length 100000, 100000 px isn't between 1 and 20000 px"),
        ((0.8, 0.8, 319.5, 239.5), "focal length 0.8, 0.8 px isn't between"),
        ((800.0, 8e3, 319.5, 239.5), "focal length 800, 8000 px differs by more than 3 times"),
        ((800.0, 800.0, 1e4, 239.5), "principal point 10000, 239.5 px is further than 4096 px"),
        ((800.0, 800.0, 319.5, -1e9), "principal point 319.5, -1e.09 px is further than"),
    ],
)
def test_what_is_no_camera_is_refused(figures: tuple[float, ...], said: str) -> None:
    """A strip's grid of it has more pixels than any memory; or nothing is seen of the surface."""
    with pytest.raises(CameraError, match=said):
        Camera(640, 480, *figures)


@pytest.mark.parametrize(
    "camera",
    [
        (2048, 2048, 2e4, 2e4, 1023.5, 1023.5),  # 6° wide
        (32, 32, 8.0, 8.0, 15.5, 15.5),  # a fisheye of few pixels
        (64, 48, 1200.0, 1180.0, -1400.0, 900.0),  # a corner of a sensor
        (640, 480, 800.0, 1600.0, 319.5, 239.5),  # every other row
    ],
)
def test_odd_cameras_are_cameras(camera: tuple[int, int, float, float, float, float]) -> None:
    assert Camera(*camera).width == camera[0]
