"""When the robot is at rest, by poses alone, and when a scan's last events have come."""

import numpy as np
import pytest

from roller_core.passes import REST_M, REST_S, rest_begin
from roller_core.sensor_pose import SensorFrames

MS = 1_000_000


def along(x: np.ndarray, period_ms: int = 8) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(len(x)) * period_ms * MS, np.stack([x, 0 * x, 0 * x], 1)


@pytest.mark.parametrize("period_ms", [2, 8])
def test_rest_begins_where_the_sensor_stops_and_later_poses_change_nothing(period_ms: int) -> None:
    t = np.arange(0.0, 1.0, period_ms * 1e-3)
    noise = np.random.default_rng(1).normal(0, 1e-5, len(t))
    times, places = along(np.where(t < 0.3, 0.3 * t, 0.09) + noise, period_ms)
    whole = rest_begin(times, places)
    assert whole is not None
    assert times[whole] == pytest.approx(300 * MS, abs=period_ms * MS)
    found = [rest_begin(times[:n], places[:n]) for n in range(len(times) + 1)]
    first = next(n for n, k in enumerate(found) if k is not None)
    assert times[first - 1] - times[whole] == pytest.approx(REST_S * 1e9, abs=period_ms * MS)
    assert set(found[first:]) == {whole}


def test_turning_back_and_creeping_are_no_rest() -> None:
    t = np.arange(0.0, 2.0, 0.008)
    # At 0.5 m/s² the same places come again within the time, further ones between.
    assert rest_begin(*along(0.25 * (t - 1) ** 2)) is None
    assert rest_begin(*along(1.1 * REST_M / REST_S * t)) is None
    assert rest_begin(*along(0.5 * REST_M / REST_S * t)) == 0
    assert rest_begin(np.zeros(0, np.int64), np.zeros((0, 3))) is None


def test_frames_tell_since_when_the_robot_is_at_rest() -> None:
    frames, turn = SensorFrames(), (0.0, 0.0, 0.0, 1.0)
    assert frames.rest_ns is None
    for k in range(40):
        x = 0.002 * min(k, 20) + (1e-5 if k % 2 else 0.0)
        frames.add("base", "tool0_controller", k * 8 * MS, (x, 0.0, 0.0), turn)
    assert frames.rest_ns == (20 * 8 * MS, 39 * 8 * MS)
    frames.restart()
    assert frames.rest_ns is None
