"""Delay of event stamps against poses, on scans that go to and fro with a known delay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibration.bidirectional_scan import (
    DEPTH_M,
    LEVEL,
    PIXEL_M,
    scan_of,
    swinging,
    there_and_back,
)
from emvs.scenes import CAMERA, Motion, track_of
from roller_calibration import Scan, TimeOffsetError, estimate_time_offset
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.transforms import rotation_vector_to_quaternion


@pytest.mark.parametrize("delay_s", [0.0013, -0.0007])
def test_two_speeds_tell_delay_from_way(delay_s: float) -> None:
    scans = [scan_of(there_and_back(v), delay_s) for v in (0.1, 0.25)]
    found = estimate_time_offset(scans, DEPTH_M)
    assert found.delay_s == pytest.approx(delay_s, abs=4e-5)
    assert found.deviation_s < 1e-4
    # An event comes as the point enters the pixel, half a pixel before its middle.
    assert found.late_m == pytest.approx(-PIXEL_M / 2, abs=1e-5)
    assert found.speeds_m_s == pytest.approx((0.1, 0.25), rel=0.03)


def test_one_speed_holds_both() -> None:
    found = estimate_time_offset([scan_of(there_and_back(0.2), 0.001)], DEPTH_M)
    assert found.late_m is None
    assert found.delay_s == pytest.approx(0.001 - PIXEL_M / 2 / 0.2, abs=4e-5)


def test_a_swing_has_speeds_enough() -> None:
    found = estimate_time_offset([scan_of(swinging(0.4), 0.0011)], DEPTH_M)
    assert found.late_m is not None
    assert found.deviation_s < 1.5e-4
    assert found.delay_s == pytest.approx(0.0011, abs=3 * found.deviation_s)


def test_depth_hardly_matters_and_a_far_base_not_at_all() -> None:
    course = there_and_back(0.2)
    near = scan_of(course, 0.001)

    def far_away(t: float) -> tuple[np.ndarray, np.ndarray]:
        return course.motion(t)[0] + [3000.0, -2000.0, 500.0], LEVEL

    far = replace(near, track=track_of(far_away, course.duration_s))
    expected = estimate_time_offset([near], DEPTH_M).delay_s
    assert estimate_time_offset([far], DEPTH_M).delay_s == pytest.approx(expected, abs=1e-6)
    other = estimate_time_offset([near], DEPTH_M + 5e-4).delay_s
    assert other == pytest.approx(expected, abs=5e-5)


def test_a_camera_a_quarter_turn_round() -> None:
    course = there_and_back(0.2)
    level = scan_of(course, 0.001)
    quarter: Motion = lambda t: (  # noqa: E731
        course.motion(t)[0],
        rotation_vector_to_quaternion([0.0, 0.0, -np.pi / 2]),
    )
    e, f = level.events, CAMERA.fx
    upright = Camera(CAMERA.height, CAMERA.width, f, f, CAMERA.cy, CAMERA.cx)
    turned = EventArray.from_arrays(CAMERA.height - 1 - e.y, e.x, e.t_ns, e.p)
    scan = Scan(turned, upright, track_of(quarter, course.duration_s))
    expected = estimate_time_offset([level], DEPTH_M).delay_s
    assert estimate_time_offset([scan], DEPTH_M).delay_s == pytest.approx(expected, abs=5e-6)


def one_way() -> Scan:
    scan = scan_of(there_and_back(0.2), 0.0)
    half = int(np.searchsorted(scan.events.t_ns, 95_000_000))
    return Scan(scan.events[:half], CAMERA, track_of(there_and_back(0.2).motion, 0.08))


def nothing_seen() -> Scan:
    scan = scan_of(there_and_back(0.2), 0.0)
    return Scan(scan.events[:100], CAMERA, scan.track)


def standing() -> Scan:
    scan = scan_of(there_and_back(0.2), 0.0)
    return Scan(scan.events, CAMERA, track_of(lambda _: (np.zeros(3), LEVEL), 0.2))


def even_lines() -> Scan:
    return scan_of(there_and_back(0.2), 0.0, np.arange(-0.02, 0.05, 0.0013))


def noise() -> Scan:
    rng = np.random.default_rng(0)
    n = 60_000
    x, y = rng.integers(0, 320, n), rng.integers(0, 120, n)
    times = np.sort(rng.integers(0, 200_000_000, n))
    events = EventArray.from_arrays(x, y, times, rng.integers(0, 2, n))
    return Scan(events, CAMERA, track_of(there_and_back(0.2).motion, 0.2))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (one_way, "one way only"),
        (nothing_seen, "fewer than"),
        (standing, "moves by less"),
        (even_lines, "the relief repeats"),
        (noise, "agree nowhere"),
    ],
)
def test_what_tells_nothing_is_refused(make: Callable[[], Scan], says: str) -> None:
    with pytest.raises(TimeOffsetError, match=says):
        estimate_time_offset([make()], DEPTH_M)
