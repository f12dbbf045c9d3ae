"""Events that end before the way does: the rest of the part was not seen."""

from collections.abc import Callable

import numpy as np
import pytest

from emvs.scenes import CAMERA, events_of, lines, rolling, tilted, track_of
from roller_core.outputs import EVENTS_ENDED, ScanFault
from roller_core.passes import travel_since
from roller_emvs.surface_stage import SurfaceParameters, SurfaceStage


def told(seconds: float, speed_m_s: float = 0.3) -> list[str]:
    """What is said of a way of some seconds, with events over its first 0.16 s."""
    stage = SurfaceStage(SurfaceParameters.create({}))
    stage.take_camera(CAMERA)
    stage.take_poses(track_of(rolling(speed_m_s), seconds))
    stage.take_events(events_of(lines(tilted), rolling(speed_m_s), 0.16))
    found = [*stage.results(flush=True), *stage.results(flush=True)]
    faults = [o.data for result in found for o in result.outputs if isinstance(o.data, ScanFault)]
    assert all(fault.part == "data" for fault in faults)
    return [fault.text for fault in faults if fault.text.startswith(EVENTS_ENDED)]


def test_it_is_said_once_and_how_much_of_the_way() -> None:
    (said,) = told(0.36)
    way_mm = float(said.split("last ")[1].split(" mm")[0])
    assert way_mm == pytest.approx(60.0, abs=6.0)


@pytest.mark.parametrize(("seconds", "speed_m_s"), [(0.16, 0.3), (0.22, 0.3), (0.7, 0.015)])
def test_the_last_poses_of_a_recording_are_no_such_way(seconds: float, speed_m_s: float) -> None:
    """They come a little later than its last packet; or the robot hardly moves."""
    assert told(seconds, speed_m_s) == []


def gone(place: Callable[[float], tuple[float, float]], t_s: float = 0.2) -> float:
    """Way after a time, mm, of a camera that looks down: along the roll and up, by time."""

    def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
        x, z = place(t)
        return np.array([x, 0.0, z]), np.array([1.0, 0.0, 0.0, 0.0])

    return 1e3 * travel_since(track_of(motion, 0.6), round(t_s * 1e9))


def test_what_the_sensor_does_after_its_events() -> None:
    assert gone(lambda t: (0.3 * t, 0.0)) == pytest.approx(120.0, abs=8.0)
    # To and fro it may end where they did.
    assert gone(lambda t: (0.3 * min(t, 0.8 - t), 0.0)) == pytest.approx(60.0, abs=6.0)
    # It stood when they ended, and then lifts off and goes home.
    assert gone(lambda t: (0.3 * min(t, 0.1) - 0.5 * max(t - 0.3, 0.0), max(t - 0.3, 0.0))) == 0.0
    # Or rolls on beside the part, which was seen.
    assert gone(lambda t: (0.3 * min(t, 0.1) + 0.3 * max(t - 0.3, 0.0), 0.0)) == 0.0
    # Or it lifts off at once: 1 mm up it is off the surface.
    assert gone(lambda t: (0.3 * t, 0.5 * max(t - 0.2, 0.0))) < 1.5
    assert gone(lambda t: (0.3 * t, 0.0), 0.7) == 0.0
