"""Arrays of a user's own as events and poses: taken, or refused with what is wrong."""

import numpy as np
import pytest

from emvs.scenes import CAMERA, rolling, track_of
from roller_braille.pipeline import BraillePipeline
from roller_braille.reader_settings import BrailleSettings
from roller_core.dead_time import DeadTime
from roller_core.events import EventArray, EventArrayError
from roller_core.pose_track import PoseTrack, PoseValueError
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.surface import SurfaceSettings, SurfaceSweep
from roller_emvs.pipeline import DepthPipeline


def shuffled(n: int = 5000) -> EventArray:
    rng = np.random.default_rng(1)
    return EventArray.from_arrays(
        rng.integers(0, CAMERA.width, n), rng.integers(0, CAMERA.height, n),
        rng.integers(0, 200_000_000, n), rng.integers(0, 2, n),
    )  # fmt: skip


@pytest.mark.parametrize("method", ["focus", "bma", "surface", "braille"])
def test_events_out_of_order_are_refused(method: str) -> None:
    track, given = track_of(rolling(0.3), 0.3), {"method": method}
    if method == "braille":
        engine = BraillePipeline(BrailleSettings.create({}), CAMERA, track)
    elif method == "surface":
        engine = SurfaceSweep(SurfaceSettings.create({}), CAMERA, track)
    else:
        engine = DepthPipeline(DepthSettings.create(given), CAMERA, track)
    events = shuffled()
    with pytest.raises(EventArrayError, match=r"event \d+ is 0\.\d+ s older than the one before"):
        engine.add_events(events)
    half = len(events) // 2
    events = events.sorted_by_time()
    engine.add_events(events[half:])
    with pytest.raises(EventArrayError, match=r"events begin 0\.\d+ s before the newest"):
        engine.add_events(events[:half])


def test_gaps_are_of_events_in_order_alone() -> None:
    """Those of others would be counted far beyond the histogram."""
    dead_time = DeadTime(CAMERA.width, CAMERA.height)
    gaps = dead_time._gaps
    dead_time.measure(shuffled())
    assert gaps.sum() == dead_time._total < 5000


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("x", [1.9], "'x' holds 1.9; expected whole numbers from 0 to 65535"),
        ("t_ns", [0.1234], "'t_ns' holds 0.1234; expected whole numbers"),
        ("t_ns", np.array(["2026-01-01"], "datetime64[ns]"), r"'t_ns' is datetime64\[ns\]"),
        ("t_ns", [np.nan], "'t_ns' holds values from nan"),
        ("y", ["7"], "'y' is <U1"),
        ("y", [None], "'y' is object"),
        ("p", [-1], "'p' holds values from -1 to -1; expected 0 for OFF and 1 for ON"),
        ("p", np.array([2], np.uint8), "'p' holds values from 2 to 2; expected 0 for OFF"),
        ("p", [0.6], "'p' holds 0.6; expected 0 for OFF"),
    ],
)
def test_what_is_no_event_is_refused(field: str, value: object, said: str) -> None:
    with pytest.raises(EventArrayError, match=said):
        EventArray.from_arrays(**{**{name: [1] for name in ("x", "y", "t_ns", "p")}, field: value})


def test_whole_numbers_of_any_type_are_events() -> None:
    events = EventArray.from_arrays(np.array([3.0]), np.uint32([4]), [5e9], [True])
    assert (events.x[0], events.y[0], events.t_ns[0], events.p[0]) == (3, 4, 5_000_000_000, 1)


@pytest.mark.parametrize(
    ("times", "positions", "quaternions", "said"),
    [
        ([0, 1], np.zeros((2, 2)), np.ones((2, 4)), r"shapes \(2,\), \(2, 2\) and \(2, 4\)"),
        ([0, 1], np.zeros((2, 3)), np.ones((2, 3)), r"expected \(n,\), \(n, 3\) and \(n, 4\)"),
        ([0, 1, 2], np.zeros((2, 3)), np.ones((2, 4)), r"shapes \(3,\)"),
        ([0.5, 1.5], np.zeros((2, 3)), np.ones((2, 4)), r"times 0\.5 to 1\.5; expected nanosec"),
        (["a", "b"], np.zeros((2, 3)), np.ones((2, 4)), "expected nanoseconds"),
    ],
)
def test_what_are_no_poses_is_refused_as_a_whole(
    times: object, positions: object, quaternions: object, said: str
) -> None:
    track = PoseTrack()
    with pytest.raises(PoseValueError, match=said):
        track.extend(times, positions, quaternions)
    assert not len(track)
